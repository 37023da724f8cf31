"""What is run, and in which order."""

from ocplanner.evaluation.experiments import planner_experiments, transfer_experiments


def test_every_experiment_has_a_name_of_its_own():
    for experiments in (planner_experiments((0, 1, 2)), transfer_experiments((0, 1, 2))):
        assert len({experiment.name for experiment in experiments}) == len(experiments)


def test_every_transfer_has_its_planner_trained():
    trained = {planner.name for planner in planner_experiments((0, 1, 2)) if planner.transferred}
    assert {transfer.planner.name for transfer in transfer_experiments((0, 1, 2))} == trained
