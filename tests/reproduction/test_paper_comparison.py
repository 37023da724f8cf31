"""The paper's rates beside ours."""

import json

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.reproduction.paper_comparison import comparison_table
from ocplanner.reproduction.policy_tables import TABLES
from transfer_results import transfer_result

PUBLISHED = ["78.7", "84.0", "62.0", "82.0", "69.3", "80.7", "50.0", "41.3", "44.7", "46.7"]


def rows(results) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in comparison_table(results).splitlines()]


def test_every_number_of_the_paper_is_there_before_anything_is_measured(tmp_path):
    table = rows(tmp_path)
    assert [row[2].split()[0] for row in table if "±" in row[2]] == PUBLISHED
    assert {row[3] for row in table[2:]} == {"not measured yet"}
    assert all(len(row) == 7 for row in table)


def test_transfers_of_several_seeds_have_an_interval_over_seeds(tmp_path):
    for seed, successes in enumerate((8, 10)):
        transfer_result(successes).save(tmp_path / "transfer" / f"square_sawyer_gated_masked_{seed}.json")
    (row,) = [row for row in rows(tmp_path) if "gated" in row[1]]
    assert row[3:6] == ["90.0", "69.9-100.0", "2"]


def test_a_measured_policy_stands_in_its_row(tmp_path):
    cell = {"algorithm": "bc", "observation": "image", "kind": "k1", "seeds": [{"seed": 0}, {"seed": 1}]}
    rates = {"best_mean": 70.0, "last5_mean": 61.5, "last5_interval": [55.0, 66.1]}
    (tmp_path / TABLES[1].name).write_text(json.dumps({"cells": [cell | rates]}))
    (row,) = [row for row in rows(tmp_path) if row[1] == "BC (image), k = 1, from the object"]
    assert row[2:6] == ["69.3 ± 3.1", "70.0 best, 61.5 last five", "55.0-66.1", "2"]


def test_a_damaged_result_is_named(tmp_path):
    path = tmp_path / "transfer" / "square_sawyer_time_masked_0.json"
    path.parent.mkdir()
    path.write_text("{}")
    with pytest.raises(ResultFileError, match=path.name):
        comparison_table(tmp_path)
