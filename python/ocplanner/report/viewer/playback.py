"""An episode as a viewer needs it: what is seen, where it was at each step, what was planned and what was achieved."""

from dataclasses import dataclass

import numpy as np
import trimesh

from ocplanner.control.settings import ControlSettings
from ocplanner.envs import make_env
from ocplanner.planner.planner import Planner
from ocplanner.report.viewer.bodies import body_meshes
from ocplanner.zero_shot.episode import run_episode
from ocplanner.zero_shot.task_planners import TaskPlanners

_UNPLANNED = ("grasp", "release", "recover", "go")  # phases in which no plan is followed


@dataclass(frozen=True)
class Playback:
    """T steps of an episode.

    Attributes:
        title: task, robot, way of following and seed.
        outcome: "success" or the failure class.
        meshes: body name -> mesh in the body's frame.
        positions: body name -> (T, 3), metres, world frame.
        quats_wxyz: body name -> (T, 4).
        achieved: (T, 3) of the object.
        planned: for each step the plan in force, (H, 3), or None.
        phases: for each step what the robot was doing.
    """

    title: str
    outcome: str
    meshes: dict[str, trimesh.Trimesh]
    positions: dict[str, np.ndarray]
    quats_wxyz: dict[str, np.ndarray]
    achieved: np.ndarray
    planned: list[np.ndarray | None]
    phases: list[str]

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.phases)


def record_playback(
    planner: TaskPlanners | Planner,
    robot: str,
    seed: int,
    *,
    follow: str = "gated",
    patches: tuple[str, ...] | None = None,
) -> Playback:
    """Run one zero-shot episode, the same that ``ocplanner transfer`` runs with this seed, and keep what was seen.

    Raises:
        UnknownNameError: no such robot, patch or way of following.
    """
    planners = TaskPlanners.of(planner)
    config = planners.config
    settings = ControlSettings(follow=follow)
    with make_env(
        str(config["task"]),
        robot,
        cameras=planners.cameras,
        image_size=int(config["image_size"]),
        visual=str(config["visual"] or "fast"),
        observe=str(config["observe"]),
        patches=patches,
    ) as env:
        meshes = body_meshes(env.model)
        bodies = {name: env.model.body(name).id for name in meshes}
        poses: list[tuple[np.ndarray, np.ndarray]] = []
        episode = run_episode(
            env,
            planners.by_object,
            seed,
            settings,
            on_step=lambda: poses.append((env.data.xpos.copy(), env.data.xquat.copy())),
        )
    trace = episode.trace
    plans, planned = dict(trace.plans), []
    current: np.ndarray | None = None
    for step, phase in enumerate(trace.phases):
        current = plans.get(step, current)
        planned.append(None if phase in _UNPLANNED else current)
    return Playback(
        title=f"{config['task']} on {robot}, {follow}, seed {seed}",
        outcome="success" if episode.success else str(episode.failure),
        meshes=meshes,
        positions={name: np.stack([position[body] for position, _ in poses]) for name, body in bodies.items()},
        quats_wxyz={name: np.stack([quat[body] for _, quat in poses]) for name, body in bodies.items()},
        achieved=np.stack([reading.object.position for reading in trace.readings]),
        planned=planned,
        phases=list(trace.phases),
    )
