import json
from dataclasses import replace

import numpy as np
import pytest

from ocplanner.errors import ResultFileError
from ocplanner.files.records.labels import LabelRecord
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import preset
from ocplanner.report.policy_results import PolicyKind, policy_cells, policy_kind, read_evaluation
from ocplanner.rollouts.intervals import seed_level_interval, wilson
from random_policy import random_training


def cells_of(*paths):
    return policy_cells(read_evaluation(path) for path in paths)


def test_policies_are_named_by_what_they_are(write_evaluation):
    images = random_training("bc-rnn", (1, 5), ("agentview",))
    assert policy_kind(images) == PolicyKind("BC-RNN", "image", "k = 1, 5")
    for sampler, name in {"vae": "BCQ", "gmm": "BCQ-GMM", "policy": "BCQ-BC"}.items():
        own = BCQConfig(sampler=sampler, sampler_sha256="ab" if sampler == "policy" else None)
        assert policy_kind(replace(preset("cpu", "bcq"), algorithm_settings=own)).algorithm == name
    kind = read_evaluation(write_evaluation("a", hint=(5,), origin="plan")).kind
    assert str(kind) == "BC, state, hint k = 5 from the plan"
    assert str(read_evaluation(write_evaluation("b")).kind) == "BC, state, no hint"


def test_seeds_are_grouped_and_other_settings_are_not(write_evaluation):
    paths = [write_evaluation(f"hint_{seed}", hint=(1,), seed=seed) for seed in (2, 0)]
    paths += [write_evaluation("plain"), write_evaluation("faster", learning_rate=0.25)]
    plain, faster, hinted = cells_of(*paths)
    assert [record.seed for record in hinted.records] == [0, 2]
    assert hinted.variant == "hint k = 1 from the object"
    assert plain.variant == "no hint (learning_rate 0.0005)"
    assert faster.variant == "no hint (learning_rate 0.25)"


def test_critics_are_grouped_by_their_rewards_whatever_policy_they_stand_above(write_evaluation):
    made = LabelRecord("ab", {"reward": "only", "form": "exp"})
    paths = []
    for seed in (0, 1):
        bcq = BCQConfig().proposing("policy", f"{seed}" * 64)
        for name, rewards in (("sparse", None), ("dense", made)):
            paths.append(
                write_evaluation(f"{name}_{seed}", seed=seed, rewards=rewards, algorithm="bcq", algorithm_settings=bcq)
            )
    sparse, dense = cells_of(*paths)
    assert [record.seed for record in sparse.records] == [record.seed for record in dense.records] == [0, 1]
    assert dense.variant == "no hint (rewards reward only, rewards form exp)"


def test_an_evaluation_in_two_files_counts_once(write_evaluation, tmp_path):
    path = write_evaluation("a")
    copy = tmp_path / "copy.json"
    copy.write_text(path.read_text())
    (cell,) = cells_of(path, copy)
    assert len(cell.records) == 1


def test_the_numbers_of_a_cell(write_evaluation):
    (cell,) = cells_of(write_evaluation("a", (2, 6, 4), seed=0), write_evaluation("b", (9, 3), seed=1, step=200))
    np.testing.assert_allclose(cell.best, [0.6, 0.9])
    np.testing.assert_allclose(cell.last_five, [0.4, 0.6])
    steps, rates, intervals = cell.curve()
    assert steps.tolist() == [200]  # the only step at which both were evaluated
    np.testing.assert_allclose(rates, [0.75])
    assert (intervals[0, 0], intervals[0, 1]) == seed_level_interval([np.arange(10) < 6, np.arange(10) < 9])


def test_seeds_that_disagree_widen_the_interval(write_evaluation):
    """The episodes of a training share its luck: together they are no sample of one binomial distribution."""
    (cell,) = cells_of(*(write_evaluation(str(seed), [good] * 5, seed=seed) for seed, good in enumerate((2, 5, 8))))
    low, high = cell.interval
    pooled = wilson(75, 150)
    assert low < pooled[0] - 0.05
    assert high > pooled[1] + 0.05
    assert (cell.curve()[2][0, 1] - cell.curve()[2][0, 0]) > np.ptp(wilson(15, 30))


def test_one_training_has_wilsons_interval_at_each_checkpoint(write_evaluation):
    (cell,) = cells_of(write_evaluation("a", (2, 6)))
    np.testing.assert_allclose(cell.curve()[2], [wilson(2, 10), wilson(6, 10)])


def test_damage_is_an_error_that_names_the_file(write_evaluation):
    path = write_evaluation("a", hint=(5,))
    content = json.loads(path.read_text())
    for change in ({"labels": {}}, {"rewards": {}}, {"training": {"network": [1]}}, {"checkpoints": []}):
        path.write_text(json.dumps(content | change))
        with pytest.raises(ResultFileError, match=r"a\.json"):
            read_evaluation(path)
