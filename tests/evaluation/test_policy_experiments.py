"""The experiments of the tables."""

from pathlib import Path

from ocplanner.evaluation.policy_experiments import PolicyExperiment, data


def test_trainings_share_the_data_that_their_labels_make():
    source, work = Path("square.hdf5"), Path("work")

    def used(algorithm: str, observations: str, variant: str = "") -> str:
        return data(PolicyExperiment(algorithm, observations, variant), source, work).name

    assert used("bc", "image", "k10") == used("bc-rnn", "image", "k10s") == "square_policy_k10-object.hdf5"
    assert used("bc", "image", "k1") == "square_policy_k1-object.hdf5"
    assert used("bcq", "state", "only") == "square_state_only-penalty.hdf5"
    assert used("bcq", "state", "only-literal") == "square_state_only-literal.hdf5"
    assert (used("bc", "state"), used("bc", "image")) == ("square.hdf5", "square_policy.hdf5")
