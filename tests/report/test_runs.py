import pytest

from ocplanner.errors import ResultFileError
from ocplanner.report.runs import read_run, run_labels


def test_a_run_gives_its_curves_in_order_of_steps(write_run):
    run = read_run(write_run("run", steps=3))
    steps, values = run.series("vae", "valid_loss")
    assert steps.tolist() == [0, 100, 200]
    assert values.tolist() == [2.0, 1.0, 2.0 / 3]


def test_final_errors_say_which_stage_was_kept(write_run):
    final = read_run(write_run("run")).held_out()
    assert [(errors.candidate, errors.appearance, errors.kept) for errors in final] == [
        ("predictor", "source", False),
        ("predictor", "IIWA", False),
        ("finetune", "source", True),
        ("finetune", "IIWA", True),
    ]
    assert final[0].values["ade_mm"] == 30.0


def test_a_run_that_goes_on_gives_its_latest_errors(write_run):
    folder = write_run("run", steps=3)
    lines = [line for line in (folder / "metrics.jsonl").read_text().splitlines() if '"final"' not in line]
    (folder / "metrics.jsonl").write_text("\n".join(lines) + "\n")
    latest = read_run(folder).held_out()
    assert [(errors.candidate, errors.kept, errors.values["valid_loss"]) for errors in latest] == [
        ("predictor", False, 2.0 / 3),
        ("finetune", False, 2.0 / 3),
    ]


def test_the_facts_come_from_the_settings_and_from_the_network(write_run):
    facts = read_run(write_run("run", horizon=50, seed=3)).facts
    assert [facts.get(name) for name in ("horizon", "seed", "encoder", "absent")] == ["H = 50", "seed 3", "small", None]


def test_a_run_without_a_configuration_has_curves_but_no_settings(write_run):
    folder = write_run("run", steps=3)
    (folder / "config.yaml").unlink()
    run = read_run(folder)
    assert (run.settings, run.facts, run.of_policy) == (None, {}, False)
    assert len(run.series("vae", "valid_loss")[0]) == 3


def test_a_resumed_run_keeps_the_last_value_of_a_repeated_step(write_run):
    folder = write_run("run", steps=2)
    with (folder / "metrics.jsonl").open("a") as file:
        file.write('{"step": 100, "stage": "vae", "valid_loss": 7.0}\n')
    assert read_run(folder).series("vae", "valid_loss")[1].tolist() == [2.0, 7.0]


def test_values_that_are_not_finite_are_left_out(write_run):
    folder = write_run("run", steps=1)
    with (folder / "metrics.jsonl").open("a") as file:
        file.write('{"step": 100, "stage": "vae", "valid_loss": NaN}\n')
    assert read_run(folder).series("vae", "valid_loss")[0].tolist() == [0]


def test_a_last_line_cut_by_a_kill_is_left_out(write_run):
    folder = write_run("run", steps=2)
    whole = read_run(folder).rows
    with (folder / "metrics.jsonl").open("a") as file:
        file.write('{"step": 300, "sta')
    assert read_run(folder).rows == whole


@pytest.mark.parametrize("line", ['{"step": 1}', "[]", "3", "not json"])
def test_a_damaged_line_inside_is_an_error_that_names_it(write_run, line):
    folder = write_run("run")
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    (folder / "metrics.jsonl").write_text("\n".join([lines[0], line, *lines[1:]]))
    with pytest.raises(ResultFileError, match="line 2"):
        read_run(folder)


def test_a_folder_without_metrics_is_an_error(tmp_path):
    with pytest.raises(ResultFileError, match=r"metrics\.jsonl"):
        read_run(tmp_path)


@pytest.mark.parametrize("text", ["- a list\n", "a: [unclosed\n", "network: 3\n", "network: {hint: [5]}\n"])
def test_a_damaged_configuration_is_an_error(write_run, text):
    folder = write_run("run")
    (folder / "config.yaml").write_text(text)
    with pytest.raises(ResultFileError, match=r"config\.yaml"):
        read_run(folder)


def test_labels_say_in_what_runs_differ(write_run):
    by_horizon = [read_run(write_run(f"h{horizon}", horizon=horizon)) for horizon in (5, 20)]
    assert run_labels(by_horizon) == ["H = 5", "H = 20"]
    assert run_labels([*by_horizon, read_run(write_run("other", seed=1))])[2] == "H = 20, seed 1"


def test_labels_of_equal_runs_fall_back_to_their_folders(write_run):
    assert run_labels([read_run(write_run("a")), read_run(write_run("b"))]) == ["a", "b"]


def test_policies_are_labelled_by_what_they_are(write_run, write_policy_run):
    runs = [read_run(write_policy_run("plain")), read_run(write_policy_run("hint", hint=(1, 5), seed=3))]
    assert [run.of_policy for run in [*runs, read_run(write_run("planner"))]] == [True, True, False]
    assert run_labels(runs) == ["no hint, seed 0", "hint k = 1, 5, seed 3"]
    assert str(runs[0].policy_kind) == "BC, state, no hint"
