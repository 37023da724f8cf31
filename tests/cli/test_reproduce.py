"""``ocplanner reproduce`` with commands that leave what the real ones leave, at once."""

import hashlib
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from ocplanner.cli import main
from ocplanner.reproduction import held_out, reproduction
from ocplanner.reproduction.experiments import planner_experiments
from ocplanner.zero_shot.result import Matrix
from random_policy import random_training, result_of
from transfer_results import transfer_result

NAMES = [experiment.name for experiment in planner_experiments((0,))]


def transferred(arguments, successes=None):
    """Write what a command of `transfer` or `matrix` writes; half of the episodes succeed if not said otherwise."""
    options, noise = dict(pairwise(arguments)), (0.0, 0.0)
    if "--pose-noise" in arguments:
        at = arguments.index("--pose-noise")
        noise = (float(arguments[at + 1]), float(arguments[at + 2]))
    planner = Path(options.get("--planner", "absent"))
    sha256 = hashlib.sha256(planner.read_bytes()).hexdigest() if planner.exists() else "ab" * 32
    episodes, out = int(options["--episodes"]), Path(options["--out"])
    result = transfer_result(
        (episodes + 1) // 2 if successes is None else successes,
        episodes,
        robot=options.get("--robot", "Panda"),
        follow=options.get("--follow", "gated"),
        observe=next((name for name in ("no-robot", "full") if name in planner.stem), "masked"),
        planner_sha256=sha256,
        mask_error=int(options.get("--mask-error", 0)),
        pose_noise=noise,
        pose_filter=int(options.get("--pose-filter", 1)),
    )
    if arguments[0] == "matrix":
        Matrix("ocplanner matrix", (result, replace(result, robot="IIWA"))).save(out)
    else:
        result.save(out)


@pytest.fixture
def commands(monkeypatch, tmp_path):
    """The commands run, each writing the file that its real counterpart writes."""
    ran = []

    def run(arguments, log):
        verb, options = arguments[0], dict(pairwise(arguments))
        ran.append((verb, Path(options.get("--run") or options.get("--out") or arguments[2]).name))
        if verb == "render":
            Path(arguments[2]).parent.mkdir(parents=True, exist_ok=True)
            Path(arguments[2]).touch()
        elif verb == "train-planner":
            folder = Path(options["--run"])
            folder.mkdir()
            row = {"stage": "final", "candidate": "predictor", "kept": True, "appearance": "source"}
            errors = {"ade_mm": 1.0, "fde_mm": 1.0, "path_mm": 1.0}
            (folder / "metrics.jsonl").write_text(json.dumps(row | errors) + "\n")
            (folder / "planner.safetensors").write_text(f"{folder}")
        else:
            transferred(arguments, successes=1)

    monkeypatch.setattr(reproduction, "run_command", run)
    monkeypatch.chdir(tmp_path)
    return ran


def planners(*flags: str) -> None:
    assert main(["reproduce", "planners", "--seeds", "0", "--workers", "1", *flags]) == 0


def rows() -> dict[str, dict]:
    return {row["planner"]: row for row in held_out.read(Path("results"))["rows"]}


def test_a_new_work_folder_keeps_what_the_results_hold(commands, capsys):
    planners("--work", "one")
    assert [name for verb, name in commands if verb == "train-planner"] == NAMES
    assert list(rows()) == NAMES
    commands.clear()
    capsys.readouterr()
    planners("--work", "two")
    assert commands == []
    assert capsys.readouterr().out.splitlines() == [f"kept {name}" for name in NAMES]
    assert list(rows()) == NAMES


def test_a_planner_without_its_file_is_trained_again_and_only_it(commands):
    planners("--work", "one")
    lost = Path("results/planners/square_full_h20_pose_0.safetensors")
    lost.unlink()
    commands.clear()
    planners("--work", "two")
    assert commands == [("render", "square_full.hdf5"), ("train-planner", "square_full_h20_pose_0")]
    assert lost.read_text() == "two/square_full_h20_pose_0"
    assert list(rows()) == NAMES


def test_other_encoders_are_asked_for(monkeypatch, commands):
    asked = []
    run = reproduction.run_command

    def note(arguments, log):
        if arguments[0] == "train-planner":
            asked.append(arguments[arguments.index("--channels") + 1 :][:2])
        run(arguments, log)

    monkeypatch.setattr(reproduction, "run_command", note)
    planners("--channels", "4", "8", "--work", "narrow", "--results", "results/narrow")
    assert asked == [["4", "8"]] * len(NAMES)
    assert Path(f"results/narrow/planners/{NAMES[0]}.safetensors").exists()


def test_again_trains_all(commands):
    planners("--work", "one")
    commands.clear()
    planners("--work", "two", "--again")
    assert [name for verb, name in commands if verb == "train-planner"] == NAMES
    assert Path(f"results/planners/{NAMES[0]}.safetensors").read_text() == f"two/{NAMES[0]}"
    assert list(rows()) == NAMES


def test_the_tables_follow_each_transfer(commands, monkeypatch, capsys):
    trained = Path("results/planners/square_masked_h20_pose_0.safetensors")
    trained.parent.mkdir(parents=True)
    trained.touch()
    for path in (Path("README.md"), Path("results/README.md")):
        path.write_text("<!-- TABLE -->\n<!-- end TABLE -->\n<!-- MASKERROR -->\n<!-- end MASKERROR -->\n")
    ran, instant = reproduction.run_command, []

    def stopped(arguments, log):
        instant.append(Path("README.md").read_text().count("1/7"))
        if len(instant) == 3:
            raise KeyboardInterrupt
        ran(arguments, log)

    monkeypatch.setattr(reproduction, "run_command", stopped)
    zero_shot = ["reproduce", "zero-shot", "--seeds", "0", "--episodes", "7"]
    assert main(zero_shot) == 130
    assert instant == [0, 1, 2]
    monkeypatch.setattr(reproduction, "run_command", ran)
    assert main(zero_shot) == 0
    assert "left out transfer/square_sawyer_gated_full_0: there is no" in capsys.readouterr().out
    for path in (Path("README.md"), Path("results/README.md")):
        assert "| gated | masked | 1/7 | 1/7 | 1/7 |" in path.read_text()
        assert "| Sawyer | gated | 1/7 | 1/7 | 1/7 | 1/7 |" in path.read_text()


@pytest.fixture
def transfers(monkeypatch, tmp_path):
    """The transfers that were asked for, each with half its episodes successful."""
    asked = []

    def run(arguments, log):
        asked.append(arguments)
        transferred(arguments)

    monkeypatch.setattr(reproduction, "run_command", run)
    monkeypatch.chdir(tmp_path)
    return asked


def test_the_matrix_is_remade_with_its_picture_and_table(transfers, capsys):
    Path("results").mkdir()
    Path("results/README.md").write_text("<!-- MATRIX -->\n<!-- end MATRIX -->\n")
    assert main(["reproduce", "matrix", "--workers", "3", "--seeds", "1"]) == 0
    (arguments,) = transfers
    options = dict(pairwise(arguments))
    assert arguments[0] == "matrix"
    assert (options["--episodes"], options["--workers"], options["--planner-seed"]) == ("50", "3", "1")
    assert Path("docs/images/matrix.png").exists()
    assert "| Square | 25/50 (37-63 %) | 25/50 (37-63 %) |" in Path("results/README.md").read_text()


def test_pose_noise_is_tried_in_all_sizes_plotted_and_not_done_again(transfers):
    Path("results").mkdir()
    Path("results/README.md").write_text("<!-- POSENOISE -->\n<!-- end POSENOISE -->\n")
    assert main(["reproduce", "pose-noise", "--episodes", "4"]) == 0
    asked = {tuple(words[words.index("--pose-noise") + 1 :][:4]) for words in transfers}
    assert len(asked) == len(transfers) == 16
    assert ("10", "5", "--pose-filter", "8") in asked
    assert Path("docs/images/pose_noise.png").exists()
    assert "| 8 steps | 5° | 1/2 | 1/2 | 1/2 | 1/2 |" in Path("results/README.md").read_text()
    transfers.clear()
    assert main(["reproduce", "pose-noise", "--episodes", "4"]) == 0
    assert transfers == []


@pytest.mark.parametrize("part", ["zero-shot", "pose-noise"])
def test_results_of_other_episodes_or_another_planner_are_not_taken_for_what_was_asked(transfers, capsys, part):
    planner = Path("results/planners/square_masked_h20_pose_0.safetensors")
    planner.parent.mkdir(parents=True)
    planner.write_text("one")
    command = ["reproduce", part, "--seeds", "0", "--episodes"]
    assert main([*command, "8"]) == 0
    transfers.clear()
    assert main([*command, "8"]) == 0
    assert main([*command, "4"]) == 2
    assert "holds" in (error := capsys.readouterr().err)
    assert "give the --episodes that made it" in error
    planner.write_text("another")
    assert main([*command, "8"]) == 2
    assert f"is of another planner than {planner}" in capsys.readouterr().err
    assert transfers == []


@pytest.fixture
def ran(monkeypatch, tmp_path):
    """The commands that were run, (verb, options), without running them: each makes its file."""
    found = []

    def run(arguments, log):
        verb, options = arguments[0], dict(pairwise(arguments))
        found.append((verb, options))
        made = {"render": arguments[2], "label": arguments[2], "evaluate": options.get("--out")}.get(verb)
        made = Path(made or f"{options['--run']}/policy.safetensors")
        made.parent.mkdir(parents=True, exist_ok=True)
        training = replace(random_training(), steps=1000, batch=64)
        result_of(training, [25, 20, 20, 20, 15], 50).save(made)  # whole at once: others read what is there meanwhile

    monkeypatch.setattr(reproduction, "run_command", run)
    monkeypatch.chdir(tmp_path)
    return found


def test_table_1_runs_what_is_missing_and_gathers_it(ran, capsys):
    assert main(["reproduce", "--table", "1", "--seeds", "0", "--workers", "1"]) == 0
    verbs = [verb for verb, _ in ran]
    assert [verbs.count(verb) for verb in ("render", "label", "train-policy", "evaluate")] == [2, 2, 9, 9]
    of_hints = [options for verb, options in ran if verb == "evaluate" and "--planner" in options]
    assert len(of_hints) == 5
    assert all(options["--last"] == "5" for options in of_hints)
    rows = json.loads(Path("results/table1.json").read_text())["cells"]
    assert [(row["algorithm"], row["observation"], row["kind"]) for row in rows] == [
        ("bc", "state", ""), ("bc-rnn", "state", ""),
        *(("bc", "image", hint) for hint in ("", "k1", "k10", "k10s")),
        *(("bc-rnn", "image", hint) for hint in ("", "k1", "k10s")),
    ]  # fmt: skip
    ran.clear()
    assert main(["reproduce", "--table", "1", "--seeds", "0"]) == 0
    assert main(["reproduce", "--table", "1", "--seeds", "0", "--episodes", "40"]) == 2
    assert "holds 50 episodes a checkpoint, not 20; give the --episodes that made it" in capsys.readouterr().err
    assert ran == []
    assert main(["reproduce"]) == 2
    assert main(["reproduce", "tables", "--table", "1"]) == 2
    assert "--table 1" in capsys.readouterr().err
    assert main(["reproduce", "tables", "--results", "nowhere"]) == 2
    assert "no page with tables belongs to nowhere" in capsys.readouterr().err


def test_table_2_labels_states_and_images_with_rewards(ran):
    assert main(["reproduce", "--table", "2", "--seeds", "0", "--workers", "1"]) == 0
    labels = [options for verb, options in ran if verb == "label"]
    assert [(options["--reward"], options["--form"]) for options in labels] == [
        ("only", "penalty"), ("augment", "penalty"),
        ("only", "exp"), ("only", "penalty"), ("only", "literal"),
        ("only", "exp"), ("augment", "exp"),
    ]  # fmt: skip
    assert all("masked" in options["--pictures"] for options in labels)
    verbs = [verb for verb, _ in ran]
    assert (verbs.count("train-policy"), verbs.count("evaluate")) == (15, 13)  # two policies propose to critics
    assert not any("--planner" in options for verb, options in ran if verb == "evaluate")
    rows = json.loads(Path("results/table2.json").read_text())["cells"]
    assert [(row["observation"], row["kind"]) for row in rows if row["published_best"] is not None] == [
        ("state", ""), ("image", ""), ("image", "augment"), ("image", "only"),
    ]  # fmt: skip
    assert {row["variant"] for row in rows} == {"original", "augment", "only"}
