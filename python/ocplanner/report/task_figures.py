"""Pictures of a new task: can each arm reach the grasps that the task defines?"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ocplanner.envs import make_env
from ocplanner.envs.tasks import Task
from ocplanner.errors import InvalidValueError
from ocplanner.geometry.pose import Pose
from ocplanner.report.overlays import film_strip

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
    """Draw each arm with its open hand at the grasp that it reaches best, after the object has come to rest.

    The title of each picture names that grasp and the distance that inverse kinematics leaves to it. More than a few
    millimetres mean that the arm reaches none of the grasp frames.

    Args:
        task: a task or its name.
        robots: names of arms.
        seed: seed of the episode.
        opening: opening of the hand, metres.
        camera: name of the camera.
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
            site = Pose(np.zeros(3), env.robot.rotation_grasp_site)
            grasps = {
                grasp.name: env.object_pose() @ grasp.pose_object_eef @ site for grasp in env.task.object().grasps
            }
            errors = {name: env.place_eef(pose, opening) for name, pose in grasps.items()}
            best = min(errors, key=lambda name: round(errors[name], 3))
            error = env.place_eef(grasps[best], opening)
            pictures.append(env.render(camera, size, size))
            titles.append(f"{robot}: {best}, {1000 * error:.0f} mm off")
    return film_strip(pictures, count=len(pictures), columns=columns, titles=titles)
