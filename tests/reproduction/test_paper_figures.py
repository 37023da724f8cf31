"""The paper's figures with commands that leave what the real ones leave, at once."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from ocplanner.cli import main
from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import new_figure
from ocplanner.drawing.video import write_video
from ocplanner.reproduction import paper_figures, reproduction
from transfer_results import transfer_result


@pytest.fixture
def ran(monkeypatch, tmp_path, tiny_square):
    """The commands run, (verb, name of what it made), each making what its real counterpart makes."""
    found = []

    def run(arguments, log):
        verb, options = arguments[0], dict(pairwise(arguments))
        made = Path(options.get("--run") or options.get("--out") or arguments[2])
        found.append((verb, made.name))
        if verb == "render":
            made.parent.mkdir(parents=True, exist_ok=True)
            made.write_bytes(Path(arguments[1]).read_bytes())
        elif verb == "train-planner":
            made.mkdir(parents=True)
            rows = [
                {"stage": stage, "step": step, "valid_loss": 1.0 / step}
                for stage in ("vae", "predictor")
                for step in (1, 2)
            ]
            (made / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
            (made / "config.yaml").write_text(f"network:\n  horizon: {options['--horizon']}\n")
            (made / "planner.safetensors").touch()
        else:
            video = made.with_suffix("") / "episode_10000.mp4"
            video.parent.mkdir(parents=True)
            write_video(video, np.zeros((3, 64, 64, 3), dtype=np.uint8))
            transfer_result(1, 1).save(made)

    monkeypatch.setattr(reproduction, "run_command", run)
    monkeypatch.chdir(tmp_path)
    Path("square_ph.hdf5").write_bytes(tiny_square().read_bytes())
    return found


@pytest.fixture
def drawn(monkeypatch):
    """The data sets and planners that plans and latents were asked of, without drawing them."""
    found = []

    def figures(planner: str, demos: Demonstrations, **_: int) -> dict[str, Figure]:
        found.append((Path(planner), demos.path.name, demos.names))
        return {name: new_figure(1, 1) for name in ("plans", "latents")}

    monkeypatch.setattr(paper_figures, "planner_figures", figures)
    monkeypatch.setattr(paper_figures.Planner, "load", str)
    return found


def figure(number: int, *flags: str) -> None:
    assert main(["reproduce", "--figure", str(number), "--workers", "1", *flags]) == 0


def test_plans_and_latents_need_no_training_where_a_planner_is_committed(ran, drawn):
    committed = Path("results/planners/square_masked_h20_pose_0.safetensors")
    committed.parent.mkdir(parents=True)
    committed.touch()
    figure(5)
    assert ran == [("render", "square_held_out_masked.hdf5")]
    figure(7)
    assert len(ran) == 1
    assert drawn == [(committed, "square_held_out_masked.hdf5", ("demo_2",))] * 2
    assert all(Path(f"docs/images/paper_figure_{number}.png").exists() for number in (5, 7))


def test_another_horizon_is_trained_once(ran, drawn):
    figure(6)
    assert ran == [
        ("render", "square_held_out_masked.hdf5"),
        ("render", "square_masked.hdf5"),
        ("train-planner", "square_masked_h50_pose_0"),
    ]
    figure(6)
    assert len(ran) == 3
    assert drawn[-1][0] == Path("runs/reproduce/square_masked_h50_pose_0/planner.safetensors")


def test_losses_are_those_of_three_horizons(ran, capsys):
    figure(4)
    assert [name for verb, name in ran if verb == "train-planner"] == [
        f"square_masked_h{horizon}_pose_0" for horizon in (5, 20, 50)
    ]
    assert "docs/images/paper_figure_4.png" in capsys.readouterr().out


def test_another_preset_has_planners_and_pictures_of_its_own(ran):
    figure(4, "--preset", "robomimic", "--seeds", "3")
    assert ("train-planner", "square_masked_h20_pose_3_robomimic") in ran
    assert [path.name for path in Path("docs/images").iterdir()] == ["paper_figure_4_robomimic.png"]


def test_a_zero_shot_episode_is_run_once(ran):
    Path("results/planners").mkdir(parents=True)
    Path("results/planners/square_masked_h20_pose_0.safetensors").touch()
    figure(8)
    figure(8)
    assert ran == [("transfer", "figure_8_cpu_0.json")]
    assert Path("docs/images/paper_figure_8.png").exists()


def test_a_figure_is_asked_for_alone(ran, capsys):
    assert main(["reproduce", "planners", "--figure", "5"]) == 2
    assert "--figure 4 to 8" in capsys.readouterr().err
