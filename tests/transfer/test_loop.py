"""Transfers of a planner with random weights: it solves nothing, but all the rest must work."""

import json

import pytest

import ocplanner as ocp
from ocplanner.cli import main
from ocplanner.envs import make_env
from ocplanner.errors import InvalidValueError, MismatchError, OutputError, UnknownNameError
from ocplanner.planner.planner import Planner
from ocplanner.report.video import read_video
from ocplanner.transfer import loop
from ocplanner.transfer.loop import make_scenario
from ocplanner.transfer.settings import GraspSettings, TransferSettings
from random_planner import write_random_planner

HASTY = TransferSettings(grasp=GraspSettings(settle_steps=1, approach_steps=2, tries=1))


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
        ({"patches": ("no-such",)}, UnknownNameError, "sawyer-base-contact"),
    ],
)
def test_refuses_what_does_not_fit(planner, options, error, message):
    with pytest.raises(error, match=message):
        ocp.transfer(planner, **{"episodes": 1, **options})


def test_mask_error_needs_masks(tmp_path):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, observe="full")
    with pytest.raises(MismatchError, match="masked"):
        make_scenario(Planner.load(path), "Sawyer", mask_error=2)


def test_the_visual_preset_is_the_planners_unless_a_mismatch_is_asked_for(planner):
    assert make_scenario(planner, "Sawyer").visual == "fast"
    assert make_scenario(planner, "Sawyer", visual="fast").visual == "fast"
    assert make_scenario(planner, "Sawyer", visual="stock", allow_mismatch=True).visual == "stock"


def test_images_of_an_unknown_preset_want_it_named(tmp_path):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, visual=None)
    planner = Planner.load(path)
    with pytest.raises(MismatchError, match="does not say with which visual preset"):
        make_scenario(planner, "Sawyer")
    assert make_scenario(planner, "Sawyer", visual="stock").visual == "stock"


def test_what_was_asked_for_is_run_and_recorded(planner, monkeypatch):
    made = []

    def make(*arguments, **options):
        made.append(make_env(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(loop, "make_env", make)
    options = {"visual": "stock", "allow_mismatch": True, "control": "stock", "settings": HASTY}
    result = ocp.transfer(planner, "Panda", episodes=1, **options)
    assert (result.visual, result.planner_visual, result.control) == ("stock", "fast", "stock")
    assert [(env.visual.name, env.control) for env in made] == [("stock", "stock")]


def test_patches_are_recorded_and_switchable(planner):
    assert make_scenario(planner, "Sawyer").patches == ("sawyer-base-contact",)
    assert make_scenario(planner, "Sawyer", patches=()).patches == ()


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


def test_command_line_says_what_is_wrong(planner, capsys):
    assert main(["transfer", "--planner", str(planner.path), "--robot", "Nobody"]) == 2
    assert "unknown robot 'Nobody'; known:" in capsys.readouterr().err
    assert main(["transfer", "--planner", "absent.safetensors"]) == 2
    assert "absent.safetensors" in capsys.readouterr().err
