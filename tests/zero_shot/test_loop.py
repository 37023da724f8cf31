"""Transfers of a planner with random weights: it solves nothing, but all the rest must work."""

import json

import pytest

import ocplanner as ocp
from ocplanner.control.settings import ControlSettings, GraspSettings
from ocplanner.drawing.video import read_video
from ocplanner.envs import make_env
from ocplanner.errors import InvalidValueError, MismatchError, OutputError, UnknownNameError, WorkerError
from ocplanner.files.journal import Journal
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot import scenario as scenario_module
from ocplanner.zero_shot.loop import _identity, run_transfer
from ocplanner.zero_shot.scenario import Stage, make_scenario
from random_planner import write_random_planner

HASTY = ControlSettings(grasp=GraspSettings(settle_steps=1, approach_steps=2, tries=1))


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = tmp_path_factory.mktemp("planner") / "p.safetensors"
    write_random_planner(path)
    return Planner.load(path)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"task": "Lift"}, MismatchError, "plans for the task Square, not Lift"),
        ({"observe": "full"}, MismatchError, "trained on observe=masked, not full"),
        ({"visual": "stock"}, MismatchError, "trained on the visual preset fast, not stock.*--allow-mismatch"),
        ({"visual": "pretty"}, UnknownNameError, "known: fast, stock"),
        ({"control": "fastest"}, UnknownNameError, "known: native, stock"),
        ({"robot": "Sawyr"}, UnknownNameError, "known: .*Sawyer"),
        ({"follow": "blind"}, UnknownNameError, "open-loop"),
        ({"episodes": 0}, InvalidValueError, "at least 1"),
        ({"mask_error": -2}, InvalidValueError, "-2 pixels"),
        ({"pose_noise": (-1.0, 0.0)}, InvalidValueError, "position is -1"),
        ({"pose_latency": -1}, InvalidValueError, "-1 steps"),
        ({"pose_filter": 0}, InvalidValueError, "at least 1"),
        ({"patches": ("no-such",)}, UnknownNameError, "sawyer-base-contact"),
    ],
)
def test_refuses_what_does_not_fit(planner, options, error, message):
    with pytest.raises(error, match=message):
        ocp.transfer(planner, **{"episodes": 1, **options})


def test_what_was_asked_for_is_run_and_recorded(planner, monkeypatch):
    made = []

    def make(*arguments, **options):
        made.append(make_env(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(scenario_module, "make_env", make)
    options = {"visual": "stock", "allow_mismatch": True, "control": "stock", "settings": HASTY}
    result = ocp.transfer(planner, "Panda", episodes=1, **options)
    assert (result.visual, result.planner_visual, result.control) == ("stock", "fast", "stock")
    assert [(env.visual.name, env.control) for env in made] == [("stock", "stock")]


def test_a_stopped_transfer_goes_on_and_films(planner, tmp_path):
    out = tmp_path / "transfer.json"
    played = []

    def stop(run):
        played.append(run.seed)
        if len(played) == 2:
            raise KeyboardInterrupt

    options = {"robot": "Panda", "episodes": 3, "settings": HASTY, "out": out, "videos": 1}
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
    straight = ocp.transfer(planner, "Panda", episodes=3, settings=HASTY)
    assert result.runs == straight.runs
    assert result.failures == {"missed grasp": 3}
    assert len(read_video(tmp_path / "transfer" / "episode_10000.mp4")) > 5


def test_episodes_done_before_videos_were_asked_for_are_filmed(planner, tmp_path):
    out = tmp_path / "transfer.json"
    film = tmp_path / "transfer" / "episode_10000.mp4"
    options = {"robot": "Panda", "episodes": 3, "settings": HASTY, "out": out}

    def stopped_after(count, **changes):
        seen = []

        def stop(run):
            seen.append(run.seed)
            if len(seen) == count:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            ocp.transfer(planner, on_episode=stop, **options, **changes)

    film.parent.mkdir()
    film.write_bytes(b"of another transfer")
    stopped_after(2)
    assert film.read_bytes() == b"of another transfer"
    stopped_after(2, videos=1)
    whole = film.read_bytes()
    assert len(read_video(film)) > 5
    film.unlink()
    seen = []
    result = ocp.transfer(planner, on_episode=lambda run: seen.append(run.seed), videos=1, **options)
    assert sorted(seen) == [10000, 10001, 10002]
    assert film.read_bytes() == whole
    straight = ocp.transfer(planner, "Panda", episodes=3, settings=HASTY)
    assert result.runs == straight.runs


def test_pose_errors_change_the_episode_by_seed_and_are_recorded(planner, tmp_path):
    options = {"robot": "Panda", "episodes": 1, "settings": ControlSettings(grasp=GraspSettings(tries=1))}
    exact, noisy, again = (
        ocp.transfer(planner, pose_noise=noise, pose_latency=latency, **options)
        for noise, latency in (((0.0, 0.0), 0), ((10.0, 5.0), 2), ((10.0, 5.0), 2))
    )
    assert noisy.runs == again.runs
    assert noisy.runs != exact.runs
    assert noisy.to_json()["pose_error"] == {"position_mm": 10.0, "rotation_deg": 5.0, "latency_steps": 2}
    out = tmp_path / "transfer.json"
    Journal(tmp_path / "transfer.json.journal", _identity(make_scenario(planner, "Panda"), planner))
    with pytest.raises(OutputError, match="another pose_error"):
        ocp.transfer(planner, "Panda", episodes=1, out=out, pose_latency=1)


def test_a_result_is_given_back_only_if_it_is_of_these_episodes(planner, tmp_path):
    out = tmp_path / "transfer.json"
    panda = make_scenario(planner, "Panda", settings=HASTY)
    first = run_transfer(panda, planner, [1, 2], out=out, keep=True)
    seen = []
    options = {"out": out, "keep": True, "on_episode": seen.append}
    assert run_transfer(panda, planner, [1, 2], **options) == first
    assert seen == []
    for scenario, seeds in ((panda, [1, 3]), (make_scenario(planner, "Panda", pose_latency=1, settings=HASTY), [1, 2])):
        with pytest.raises(OutputError, match="holds another transfer"):
            run_transfer(scenario, planner, seeds, **options)
    assert [run.seed for run in run_transfer(panda, planner, [3], overwrite=True, **options).runs] == [3]


def test_an_example_that_ends_otherwise_when_it_is_filmed_is_an_error(planner, tmp_path, monkeypatch):
    scenario = make_scenario(planner, "Panda", settings=HASTY)
    played = iter([EpisodeResult(1, True, 10, None, "follower"), EpisodeResult(1, False, 12, "slip", None)])
    monkeypatch.setattr(Stage, "play", lambda stage, seed: next(played))
    with pytest.raises(WorkerError, match="seed 1 of Square on Panda ended otherwise"):
        run_transfer(scenario, planner, [1], out=tmp_path / "transfer.json", examples=1)
