from dataclasses import replace

import pytest

from ocplanner.errors import ResultFileError
from ocplanner.reproduction.policy_experiments import PolicyExperiment
from ocplanner.reproduction.policy_tables import TABLE1, TABLE2
from ocplanner.reproduction.summary import NOTHING, policy_table
from random_policy import random_training, result_of


def evaluated(results, experiment, rates):
    path = experiment.result(results)
    path.parent.mkdir(parents=True, exist_ok=True)
    training = replace(random_training(seed=experiment.seed), steps=1000 * (1 + experiment.seed), batch=64)
    result_of(training, [round(50 * rate) for rate in rates], 50).save(path)


@pytest.mark.parametrize(("table", "cells"), [(TABLE1, 9), (TABLE2, 13)])
def test_every_experiment_has_a_name_of_its_own(table, cells):
    experiments = table.experiments((0, 1, 2))
    assert len({experiment.name for experiment in experiments}) == len(experiments) == 3 * cells
    assert [experiment.seed for experiment in experiments[:cells]] == [0] * cells


def test_a_row_for_each_cell_with_every_seed(tmp_path):
    assert policy_table(TABLE1, tmp_path) == NOTHING
    for seed, best in ((0, 0.6), (1, 0.7)):
        evaluated(tmp_path, PolicyExperiment("bc", "image", "k1", seed), [0.1, best, 0.5, 0.5, 0.5, 0.5, 0.5])
    evaluated(tmp_path, PolicyExperiment("bc-rnn", "state"), [0.8] * 5)
    TABLE1.write(TABLE1.experiments((0, 1)), tmp_path)
    first, second = TABLE1.read(tmp_path)
    assert (first["algorithm"], first["observation"], first["variant"]) == ("bc-rnn", "state", "original")
    assert first["seeds"] == [{"seed": 0, "best": 80, "last5": 80}]
    assert (second["variant"], second["kind"], second["preset"]) == ("hint", "k1", "cpu")
    assert [one["best"] for one in second["seeds"]] == [60, 70]
    assert (second["best_mean"], second["best_std"]) == (65, 5)
    assert (second["last5_mean"], second["published_best"]) == (50, [69.3, 3.1])
    low, high = second["last5_interval"]
    assert 44 < low < 50 < high < 56
    assert policy_table(TABLE1, tmp_path).splitlines()[2:] == [
        "| BC-RNN (state) | none | 1,000 x 64 | **80.0** (80) | 5 | 80.0 | 74.6-84.5 | 1 | 84.0 ± 0.0 |",
        "| BC (image) | k = 1, from the object | 1,000 x 64, 2,000 x 64 | **65.0** ± 5.0 (60, 70) | 7 | 50.0 ± 0.0 | "
        "45.6-54.4 | 2 | 69.3 ± 3.1 |",
    ]


@pytest.mark.parametrize(("text", "message"), [("{", "cannot read"), ("{}", "is no evaluation of a policy")])
def test_a_damaged_evaluation_is_named(tmp_path, text, message):
    experiment = PolicyExperiment("bc", "state")
    evaluated(tmp_path, experiment, [0.5] * 5)
    experiment.result(tmp_path).write_text(text)
    with pytest.raises(ResultFileError, match=message):
        TABLE1.write([experiment], tmp_path)


def test_a_damaged_table_is_named(tmp_path):
    (tmp_path / TABLE1.name).write_text("{}")
    with pytest.raises(ResultFileError, match="--table 1"):
        TABLE1.read(tmp_path)
