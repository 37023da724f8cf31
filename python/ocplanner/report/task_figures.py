"""A task before several arms: can each of them hold the object the way the task says?"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ocplanner.envs import make_env
from ocplanner.envs.tasks import Task
from ocplanner.errors import InvalidValueError
from ocplanner.report.overlays import film_strip
from ocplanner.transfer.grasp import choose_grasp

_SETTLING_STEPS = 10  # dropped objects come to rest


def grasps_figure(
    task: str | Task,
    robots: Sequence[str],
    *,
    seed: int = 0,
    opening: float = 0.06,
    camera: str = "agentview",
    size: int = 384,
    columns: int = 4,
) -> Figure:
    """Each arm with its open hand at the grasp that a transfer would choose, in the first state of an episode.

    Above each picture: how far from the grasp inverse kinematics gets. More than a few millimetres mean that the grasp
    frame, or the object's place, is out of that arm's reach.

    Args:
        task: a task or its name.
        robots: names of arms.
        seed: of the episode.
        opening: of the hand, metres.
        camera: that sees it.
        size: side of each picture, pixels.
        columns: pictures in a row.

    Raises:
        InvalidValueError: no arm was named.
        UnknownNameError: no such task, arm or camera.
    """
    if not robots:
        raise InvalidValueError("no arm named; name at least one to draw")
    pictures, titles = [], []
    for robot in robots:
        with make_env(task, robot, cameras=()) as env:
            env.reset(seed)
            rest = np.zeros(env.action_dim)
            rest[-1] = -1.0
            for _ in range(_SETTLING_STEPS):
                env.step(rest)
            pose = env.object_pose()
            grasp = choose_grasp(env.task.object(), env.robot, pose, env.eef_pose().rotation)
            error = env.place_eef(pose @ grasp, opening)
            pictures.append(env.render(camera, size, size))
            titles.append(f"{robot}: {1000 * error:.0f} mm off the grasp")
    return film_strip(pictures, count=len(pictures), columns=columns, titles=titles)
