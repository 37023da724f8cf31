"""The tables of measured results."""

import json

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.reproduction.summary import (
    NOTHING,
    failure_table,
    held_out_table,
    mask_error_table,
    matrix_table,
    pose_noise_table,
    transfer_table,
)
from ocplanner.zero_shot.result import Matrix
from transfer_results import transfer_result


def write_result(folder, name, successes, **changes):
    transfer_result(successes, **changes).save(folder / f"{name}.json")


def test_a_cell_holds_every_seed_and_their_mean(tmp_path) -> None:
    for seed, successes in ((1, 8), (0, 9)):
        write_result(tmp_path, f"square_{seed}", successes, planner_seed=seed)
    assert transfer_table(tmp_path).splitlines() == [
        "| follow | observe | Sawyer |",
        "| --- | --- | --- |",
        "| gated | masked | **85.0 %** (9/10, 8/10) |",
    ]


def test_mask_errors_stand_beside_the_same_planner_with_exact_masks(tmp_path) -> None:
    exact, off = tmp_path / "transfer", tmp_path / "mask_error"
    assert mask_error_table(off, exact) == NOTHING
    write_result(exact, "same", 9)
    write_result(exact, "another_seed", 1, planner_seed=1)
    write_result(exact, "another_arm", 1, robot="UR5e")
    write_result(exact, "another_view", 1, observe="full")
    for pixels, successes in ((10, 3), (2, 7)):
        write_result(off, f"{pixels}px", successes, mask_error=pixels)
    assert mask_error_table(off, exact).splitlines() == [
        "| robot | follow | 0 px | 2 px | 10 px |",
        "| --- | --- | --- | --- | --- |",
        "| Sawyer | gated | 9/10 | 7/10 | 3/10 |",
    ]


def test_held_out_errors_are_those_on_the_recorded_robot(tmp_path) -> None:
    assert held_out_table(tmp_path) == NOTHING
    errors = {"ade_mm": 22.74, "fde_mm": 26.0, "path_mm": 13.6}
    pose = {"rotation_deg": 6.55, "rotation_median_deg": 5.25, "yaw_wrong_percent": 1.27}
    planner = {"planner": "p", "observe": "masked", "horizon": 20, "seed": 0}
    rows = [
        {**planner, **errors, **pose, "outputs": "pose", "candidate": "predictor", "kept": False, "appearance": arm}
        for arm in ("source", "IIWA")
    ]
    last = {"outputs": "position", "candidate": "finetune", "kept": True, "appearance": "source"}
    rows.append({**planner, **errors, **last})
    (tmp_path / "heldout.json").write_text(json.dumps({"rows": rows}))
    assert held_out_table(tmp_path).splitlines()[2:] == [
        "| masked, H = 20, pose, seed 0 | predictor | 22.7 | 26.0 | 13.6 | 6.5 (5.2) | 1.3 % |",
        "| masked, H = 20, position, seed 0 | finetune (kept) | 22.7 | 26.0 | 13.6 |  |  |",
    ]


@pytest.mark.parametrize(("text", "message"), [("{", "cannot read"), ("{}", "lacks task"), ("7", "holds a int")])
def test_a_damaged_result_is_named(tmp_path, text, message) -> None:
    (tmp_path / "square.json").write_text(text)
    with pytest.raises(ResultFileError, match=message):
        transfer_table(tmp_path)


def test_the_matrix_has_a_row_a_task_and_its_failures_a_row_a_cell(tmp_path) -> None:
    path = tmp_path / "matrix.json"
    assert matrix_table(path) == failure_table(path) == NOTHING
    cells = (
        transfer_result(10, task="Lift", robot="Panda"),
        transfer_result(0, task="Lift", robot="Jaco", failures=("missed grasp",) * 7),
        transfer_result(9, task="Can", robot="Panda"),
    )
    Matrix("", cells).save(path)
    assert matrix_table(path).splitlines() == [
        "| task | Panda | Jaco |",
        "| --- | --- | --- |",
        "| Lift | 10/10 (72-100 %) | 0/10 (0-28 %) |",
        "| Can | 9/10 (60-98 %) |  |",
    ]
    assert failure_table(path).splitlines() == [
        "| task | robot | missed grasp | slip |",
        "| --- | --- | --- | --- |",
        "| Lift | Jaco | 7 | 3 |",
        "| Can | Panda |  | 1 |",
    ]
    Matrix("", (*cells[:1], transfer_result(5, task="Lift", robot="Panda", patches=False))).save(path)
    assert matrix_table(path).splitlines()[2:] == [
        "| Lift (gated, masked) | 10/10 (72-100 %) |",
        "| Lift (gated, masked, no patches) | 5/10 (24-76 %) |",
    ]
    path.write_text("{")
    with pytest.raises(ResultFileError, match="cannot read"):
        matrix_table(path)


def test_pose_noise_is_shown_by_filter_rotation_and_position(tmp_path) -> None:
    assert pose_noise_table(tmp_path) == NOTHING
    for millimetres, degrees, steps, successes in ((10, 0, 8, 7), (2, 0, 8, 9), (2, 5, 8, 8), (2, 0, 1, 3)):
        name = f"{millimetres}_{degrees}_{steps}"
        write_result(tmp_path, name, successes, pose_noise=(float(millimetres), float(degrees)), pose_filter=steps)
    assert pose_noise_table(tmp_path).splitlines() == [
        "| averaged over | rotation noise | 2 mm | 10 mm |",
        "| --- | --- | --- | --- |",
        "| 8 steps | 0° | 9/10 | 7/10 |",
        "| 8 steps | 5° | 8/10 |  |",
        "| none | 0° | 3/10 |  |",
    ]
