"""An episode as a viewer needs it: bodies and their poses at each step, the plans in force, the object's path."""

from dataclasses import dataclass

import numpy as np
import trimesh

from ocplanner.report.viewer.bodies import body_meshes
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup


@dataclass(frozen=True)
class Playback:
    """T steps of an episode.

    Attributes:
        title: task, robot, conditions and seed.
        outcome: "success" or the failure class.
        meshes: body name -> mesh in the body's frame.
        positions: body name -> (T, 3), metres, world frame.
        quats_wxyz: body name -> (T, 4).
        achieved: (T, 3) position of the object, as the program read it.
        planned: for each step the plan in force, (H, 3), or None.
        phases: for each step the phase of the program.
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


def record_playback(setup: TransferSetup, seed: int) -> Playback:
    """Run the episode that a transfer of this setup runs with this seed, and record every body's pose at each step.

    Raises:
        OcplannerError: the planner cannot be read, or there is no working headless OpenGL.
    """
    runner = EpisodeRunner(setup)
    env = runner.env
    try:
        meshes = body_meshes(env.model)
        bodies = {name: env.model.body(name).id for name in meshes}
        poses: list[tuple[np.ndarray, np.ndarray]] = []
        episode = runner.run(seed, lambda: poses.append((env.data.xpos.copy(), env.data.xquat.copy())))
    finally:
        runner.close()
    trace = episode.trace
    return Playback(
        title=f"{setup.result.title}, seed {seed}",
        outcome="success" if episode.success else str(episode.failure),
        meshes=meshes,
        positions={name: np.stack([position[body] for position, _ in poses]) for name, body in bodies.items()},
        quats_wxyz={name: np.stack([quat[body] for _, quat in poses]) for name, body in bodies.items()},
        achieved=np.stack([reading.object.position for reading in trace.readings]),
        planned=trace.followed_plans(),
        phases=list(trace.phases),
    )
