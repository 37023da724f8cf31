"""What is run, and in which order."""

from ocplanner.reproduction.experiments import planner_experiments, pose_noise_experiments, transfer_experiments


def test_every_experiment_has_a_name_of_its_own():
    for experiments in (planner_experiments((0, 1, 2)), transfer_experiments((0, 1, 2)), pose_noise_experiments(0)):
        assert len({experiment.name for experiment in experiments}) == len(experiments)


def test_every_transfer_has_its_planner_trained():
    trained = {planner.name for planner in planner_experiments((0, 1, 2)) if planner.transferred}
    assert {transfer.planner.name for transfer in transfer_experiments((0, 1, 2))} == trained


def test_every_combination_of_pose_noise_is_tried():
    filtered = {experiment.pose_noise for experiment in pose_noise_experiments(0) if experiment.pose_filter > 1}
    assert filtered == {(millimetres, degrees) for millimetres in (0, 2, 5, 10) for degrees in (0, 2, 5)}
    as_read = {experiment.pose_noise for experiment in pose_noise_experiments(0) if experiment.pose_filter == 1}
    assert as_read == {(0, 0), (2, 0), (5, 0), (10, 0)}
