"""The committed table holds no traceback and no silent mistake, and what verbs say today is what it says."""

import json
import re
from typing import Any

import pytest
from inputs import INPUTS
from table import OUTPUT, VERBS

ROWS = {row["input"]: row["answers"] for row in json.loads(OUTPUT.read_text(encoding="utf-8"))["rows"]}
CHEAP = ("convert", "train-policy")
"""Verbs that need neither pictures nor a simulation."""
SAMPLE = {
    "plain": ("info", "convert", "render"),
    "stop-and-go": ("render",),
    "other-arm": ("render",),
    "flipped-gripper": ("label",),
    "raw-1-0": ("convert",),
    "nan-observation-skipped": ("label",),
    "unflagged-absolute": CHEAP,
    "absent-in-mask": CHEAP,
    "overlapping-masks": CHEAP,
    "no-states": CHEAP,
    "all-bad": CHEAP,
    "empty-group": CHEAP,
    "empty-group-skipped": CHEAP,
    "truncated": CHEAP,
    "locked": CHEAP,
    "lerobot-folder": ("convert", "render"),
}
STEPS, KEPT, RISEN_CM, HELD = (66, 66, 81), (29, 29, 37), (10.9, 9.8, 10.8), (26, 26, 40)
"""Of the three demonstrations as recorded."""
PACE = {"stop-and-go": 2, "slow": 5, "five-hertz": 1 / 4}
"""How many times the steps of the same motion."""
SAME = (
    "plain",
    "own-model",
    "other-size",
    "duplicate-in-mask",
    "absent-in-mask-skipped",
    "no-masks",
    "upside-down-mended",
    "flipped-gripper-mended",
    "raw-1-4",
    "raw-1-5",
    "raw-loud",
    "states-only",
)
"""Inputs that hold the same motion in the same steps, however they are stored."""
REFUSED = {
    "other-gripper": ("render", "label", "train-policy"),
    "other-arm": ("render", "label", "train-policy"),
    "other-object": ("render", "label", "train-policy"),
    "other-table": ("render", "label", "train-policy"),
    "raw-other-arm": ("convert", "render", "train-policy"),
    "upside-down": ("train-planner", "label"),
    "black": ("train-planner", "label"),
    "unflagged-absolute": ("label", "train-policy"),
    "flagged-absolute": ("label", "evaluate"),
    "flipped-gripper": ("render", "train-planner", "label"),
    "overlapping-masks": ("train-planner", "train-policy"),
    "equal-masks": ("train-planner", "train-policy"),
    "empty-mask": ("train-planner", "train-policy"),
    "absent-in-mask": ("convert", "render", "train-planner", "label", "train-policy"),
    "damaged-model": ("render", "label"),
    "hostile-model": ("render", "label"),
    "narrow-states": ("render", "label"),
}
"""Where going on would give a wrong result, or one that nothing could use."""
TOLD = (
    "never-lifted",
    "other-gripper",
    "other-arm",
    "other-object",
    "other-table",
    "damaged-model",
    "hostile-model",
    "narrow-states",
    "upside-down",
    "black",
    "float-pictures",
    "unflagged-absolute",
    "flagged-absolute",
    "flipped-gripper",
    "no-gripper-action",
    "five-hertz",
    "duplicate-in-mask",
    "absent-in-mask",
    "overlapping-masks",
    "equal-masks",
    "raw-1-0",
    "raw-1-4",
    "raw-1-5",
    "raw-loud",
    "raw-other-arm",
    "states-only",
    "no-states",
    "nan-action",
    "nan-observation",
    "infinite-state",
    "no-step",
    "one-step",
    "empty-group",
    "short-observations",
    "all-bad",
)
"""What info must say something about."""
BAD = ["nan-action", "nan-observation", "infinite-state", "no-step", "one-step", "empty-group", "never-lifted"]
"""Inputs of which demo_1 cannot be used."""


def _found(name: str, verb: str) -> dict[str, Any]:
    return ROWS[name][verb]["found"]


def _each(name: str, verb: str, key: str) -> tuple[Any, ...]:
    return tuple(_found(name, verb)[key].values())


def test_the_table_is_whole():
    assert set(ROWS) == set(INPUTS)
    assert all(set(answers) == set(VERBS) for answers in ROWS.values())


@pytest.mark.parametrize("name", INPUTS)
def test_every_answer_is_a_success_or_one_clear_error(name):
    for verb, cell in ROWS[name].items():
        answer = cell["answer"]
        assert "unexpected" not in answer, (verb, answer)
        assert "Traceback" not in answer, (verb, answer)
        assert re.match(r"ok\b|error: .{20}|no policy to evaluate$", answer), (verb, answer)
        if answer.startswith("error"):
            assert re.search(r"; |: | \| ", answer.removeprefix("error: ")), (verb, answer)


@pytest.mark.parametrize("name", SAMPLE)
def test_verbs_say_what_the_table_says(border, name):
    answers = border.row(INPUTS[name], SAMPLE[name])["answers"]
    assert answers == {verb: ROWS[name][verb] for verb in SAMPLE[name]}


@pytest.mark.parametrize("name", SAME)
def test_the_same_motion_gives_the_same_results_however_it_is_stored(name):
    assert _each(name, "convert", "steps") == STEPS
    assert "51 and 37 frames between grasp and release" in ROWS[name]["train-planner"]["answer"]
    assert _each(name, "label", "held") == HELD
    if _each(name, "render", "drawn") != STEPS:  # those without pictures are drawn whole
        assert _each(name, "render", "drawn") == KEPT
        assert _each(name, "render", "risen cm") == pytest.approx(RISEN_CM, abs=0.1)


@pytest.mark.parametrize("name", PACE)
def test_the_pace_does_not_matter(name):
    """What is kept rises as far at any pace, and the object is held in the same share of the steps."""
    assert _each(name, "render", "risen cm") == pytest.approx(RISEN_CM, abs=0.2)
    for drawn, kept in zip(_each(name, "render", "drawn"), KEPT):
        assert drawn == pytest.approx(kept * PACE[name], rel=0.2, abs=4)
    steps = sum(_each(name, "convert", "steps"))
    assert f"held in {round(sum(HELD) * PACE[name])} of {steps} steps" in ROWS[name]["label"]["answer"] or (
        name == "five-hertz"
    )


def test_states_after_the_action_lose_one_step_at_each_end():
    assert _each("raw-1-0", "convert", "steps") == tuple(steps - 2 for steps in STEPS)


def test_a_recorded_size_is_drawn():
    small, large = (sum(_each(name, "render", "red pixels")) for name in ("own-model", "other-size"))
    assert large > 1.5 * small


@pytest.mark.parametrize(("name", "verb"), [(name, verb) for name, verbs in REFUSED.items() for verb in verbs])
def test_what_would_go_wrong_is_refused(name, verb):
    assert ROWS[name][verb]["answer"].startswith("error: ")


@pytest.mark.parametrize("name", TOLD)
def test_info_tells_it(name):
    assert ROWS[name]["info"]["answer"] == "ok"
    assert _found(name, "info")["findings"]


@pytest.mark.parametrize("name", BAD)
def test_a_bad_demonstration_is_named_and_can_be_left_out(name):
    assert any("demo_1" in line for line in _found(name, "info")["findings"])
    for verb in ("convert", "render", "label"):
        before, skipped = ROWS[name][verb]["answer"], ROWS[f"{name}-skipped"][verb]["answer"]
        if before.startswith("error"):
            assert "--skip-bad" in before
            assert "demo_1" in before
            assert skipped.startswith("ok: demo_1 is left out: ")
            assert tuple(_found(f"{name}-skipped", verb)["steps"]) == ("demo_0", "demo_2")
    assert ROWS[name]["render"]["answer"].startswith("error")
    for verb in ("train-planner", "train-policy"):
        assert ROWS[f"{name}-skipped"][verb]["answer"].startswith("ok: ")


@pytest.mark.parametrize("name", ["no-states", "states-group", "mixed-states", "eight-numbers", "other-names"])
def test_policies_learn_from_other_robots_files(name):
    assert ROWS[name]["train-policy"]["answer"].startswith("ok: warning: `ocplanner evaluate` will refuse this policy")
    assert _found(name, "train-policy")["held-out losses"]
    assert ROWS[name]["convert"]["answer"].startswith("ok")


def test_a_mask_counts_each_name_once():
    assert ROWS["duplicate-in-mask"]["train-planner"]["answer"].startswith("ok: 2 demonstrations to train on, 1 held")
    assert _found("duplicate-in-mask", "render")["masks"]["train"] == ["demo_0", "demo_1"]


def test_a_turned_gripper_closes_again():
    assert _each("flipped-gripper-mended", "convert", "closing") == _each("plain", "convert", "closing")
    assert "--flip-gripper" in ROWS["flipped-gripper"]["train-policy"]["answer"]
