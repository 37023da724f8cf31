"""Transfers of a planner with random weights: it solves nothing, but all the rest must work."""

import json

import pytest

import ocplanner as ocp
from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.drawing.video import read_video
from ocplanner.envs import make_env
from ocplanner.errors import InvalidValueError, MismatchError, OutputError, UnknownNameError
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot import setup as transfer_setup
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import TransferSetup
from ocplanner.zero_shot.transfer import journal_of
from random_planner import write_random_planner

CONTROL = ControlSettings(grasp=GraspSettings(settle_steps=1, approach_steps=2, tries=1))
HASTY = TransferConfig(control=CONTROL)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = tmp_path_factory.mktemp("planner") / "p.safetensors"
    write_random_planner(path)
    return Planner.load(path)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"config": TransferConfig(visual="stock")},
            MismatchError,
            "trained on the visual preset fast, not stock.*--allow-mismatch",
        ),
        ({"robot": "Sawyr"}, UnknownNameError, "known: .*Sawyer"),
        ({"episodes": 0}, InvalidValueError, "at least 1"),
        ({"episodes": []}, InvalidValueError, "at least 1"),
    ],
)
def test_refuses_what_does_not_fit(planner, options, error, message):
    with pytest.raises(error, match=message):
        ocp.transfer(planner, **{"episodes": 1, **options})


def test_videos_without_a_result_file_are_an_error(planner):
    with pytest.raises(InvalidValueError, match=r"videos is 3.*without out"):
        ocp.transfer(planner, episodes=1, videos=3)


def test_what_was_asked_for_is_run_and_recorded(planner, monkeypatch):
    made = []

    def make(*arguments, **options):
        made.append(make_env(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(transfer_setup, "make_env", make)
    config = TransferConfig(control=CONTROL, visual="stock", allow_mismatch=True, control_loop="stock")
    result = ocp.transfer(planner, "Panda", episodes=1, config=config)
    assert (result.visual, result.planner_visual, result.settings) == ("stock", "fast", config)
    assert [(env.visual.name, env.control) for env in made] == [("stock", "stock")]


def test_seeds_can_be_named(planner):
    result = ocp.transfer(planner, "Panda", episodes=(7, 5), config=HASTY)
    assert [run.seed for run in result.runs] == [7, 5]


def test_a_stopped_transfer_goes_on_and_films(planner, tmp_path):
    out = tmp_path / "transfer.json"
    played = []

    def stop(run):
        played.append(run.seed)
        if len(played) == 2:
            raise KeyboardInterrupt

    options = {"robot": "Panda", "episodes": 3, "config": HASTY, "out": out, "videos": 1}
    with pytest.raises(KeyboardInterrupt):
        ocp.transfer(planner, on_episode=stop, **options)
    assert not out.exists()
    seen = []
    result = ocp.transfer(planner, on_episode=lambda run: seen.append(run.seed), **options)
    assert seen == [10000, 10001, 10002]
    assert json.loads(out.read_text())["episodes"] == 3
    assert not out.with_name("transfer.json.journal").exists()
    kept = out.read_bytes()
    with pytest.raises(OutputError, match=r"transfer\.json exists already.*--overwrite"):
        ocp.transfer(planner, **options)
    assert out.read_bytes() == kept
    straight = ocp.transfer(planner, "Panda", episodes=3, config=HASTY)
    assert result.runs == straight.runs
    assert result.failures == {"missed grasp": 3}
    assert len(read_video(tmp_path / "transfer" / "episode_10000.mp4")) > 5


def test_episodes_done_before_videos_were_asked_for_are_filmed(planner, tmp_path):
    out = tmp_path / "transfer.json"
    film = tmp_path / "transfer" / "episode_10000.mp4"
    options = {"robot": "Panda", "episodes": 3, "config": HASTY, "out": out}

    def stopped_after(count, **changes):
        seen = []

        def stop(run):
            seen.append(run.seed)
            if len(seen) == count:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            ocp.transfer(planner, on_episode=stop, **options, **changes)

    film.parent.mkdir()
    film.write_bytes(other := b"....ftyp: of another transfer")
    stopped_after(2)
    assert film.read_bytes() == other
    stopped_after(2, videos=1)
    whole = film.read_bytes()
    assert len(read_video(film)) > 5
    film.unlink()
    seen = []
    result = ocp.transfer(planner, on_episode=lambda run: seen.append(run.seed), videos=1, **options)
    assert sorted(seen) == [10000, 10001, 10002]
    assert film.read_bytes() == whole
    straight = ocp.transfer(planner, "Panda", episodes=3, config=HASTY)
    assert result.runs == straight.runs


def test_pose_errors_change_the_episode_by_seed_and_are_recorded(planner, tmp_path):
    control = ControlSettings(grasp=GraspSettings(tries=1))
    exact, noisy, again = (
        ocp.transfer(
            planner,
            "Panda",
            episodes=1,
            config=TransferConfig(control=control, pose_noise=noise, pose_latency=latency),
        )
        for noise, latency in (((0.0, 0.0), 0), ((10.0, 5.0), 2), ((10.0, 5.0), 2))
    )
    assert noisy.runs == again.runs
    assert noisy.runs != exact.runs
    settings = noisy.to_json()["settings"]
    assert (settings["pose_noise"], settings["pose_latency"]) == ([10.0, 5.0], 2)
    out = tmp_path / "transfer.json"
    journal_of(TransferSetup.of(planner, "Panda"), out)
    with pytest.raises(OutputError, match=r"another settings\.pose_latency;"):
        ocp.transfer(planner, "Panda", episodes=1, out=out, config=TransferConfig(pose_latency=1))
