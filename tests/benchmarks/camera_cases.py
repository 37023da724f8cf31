"""Control steps on Square with the two cameras of robomimic's image policies drawn at every step, 84 x 84.

Ours is ``env.step`` with all of robosuite's state observations and the reward, run natively, and the two pictures in
the ``fast`` visual preset. ``robosuite`` is its own ``env.step`` with its own camera observations. The same actions
from the same starts, in turns of ten steps. The time is the wall clock: software OpenGL draws with several threads
(``llvmpipe`` takes one a core unless ``LP_NUM_THREADS`` says otherwise, and the row records it), so no single thread's
time would be the whole. The ratio of the processor time of all threads stands beside it; other processes disturb that
one less.
"""

import os
from functools import partial
from typing import Any

import numpy as np
from sim_measured import SimMeasured
from turns import Turn, taking_turns

from ocplanner.envs import make_env
from ocplanner.envs.simulator import robosuite

_CAMERAS = ("agentview", "robot0_eye_in_hand")
_SIZE = 84
_EPISODE = 50
_STEPS_A_TURN = 10
_ACTION_SCALE = 0.3


class OurCameras:
    """ocplanner's environment; the pictures show what ``observe`` says."""

    def __init__(self, robot: str, observe: str) -> None:
        self._env = make_env("Square", robot, cameras=_CAMERAS, image_size=_SIZE, observe=observe)
        if self._env.control != "native":
            raise SystemExit("the native control loop does not attach here: nothing to measure")

    def prepare(self, index: int) -> None:
        """Start an episode when one is over."""
        if index % _EPISODE == 0:
            self._env.reset(index)

    def act(self, index: int) -> np.ndarray:
        """One control step; returns where the hand is."""
        self._env.robosuite_env.step(_action(index, self._env.action_dim))
        pictures = self._env.observe()
        assert all(picture.shape == (_SIZE, _SIZE, 3) for picture in pictures.values())
        return self._env.eef_pose().position


class StockCameras:
    """robosuite as its users make it."""

    def __init__(self, robot: str) -> None:
        self._env: Any = robosuite.make(
            "NutAssemblySquare",
            robots=robot,
            has_renderer=False,
            has_offscreen_renderer=True,
            use_camera_obs=True,
            camera_names=list(_CAMERAS),
            camera_heights=_SIZE,
            camera_widths=_SIZE,
            control_freq=20,
            ignore_done=True,
            hard_reset=False,
            seed=0,
        )

    def prepare(self, index: int) -> None:
        """Start an episode when one is over, as ocplanner seeds it."""
        if index % _EPISODE == 0:
            self._env.rng.bit_generator.state = np.random.default_rng(index).bit_generator.state
            self._env.reset()

    def act(self, index: int) -> np.ndarray:
        """One control step; returns where the hand is."""
        observation, *_ = self._env.step(_action(index, self._env.action_dim))
        assert all(observation[f"{camera}_image"].shape == (_SIZE, _SIZE, 3) for camera in _CAMERAS)
        return self._env.sim.data.site_xpos[self._env.robots[0].eef_site_id["right"]].copy()


def two_cameras(robot: str, steps: int) -> SimMeasured:
    """Ours against robosuite."""
    return _compare({"ours": partial(OurCameras, robot, "full"), "robosuite": partial(StockCameras, robot)}, steps)


def two_cameras_masked(robot: str, steps: int) -> SimMeasured:
    """Pictures with the robot painted flat against the full ones: what the mask costs."""
    sides = {"ours": partial(OurCameras, robot, "masked"), "unmasked": partial(OurCameras, robot, "full")}
    return _compare(sides, steps)


def _action(index: int, length: int) -> np.ndarray:
    return _ACTION_SCALE * np.random.default_rng(index).uniform(-1, 1, length)


def _compare(sides: dict[str, Any], steps: int) -> SimMeasured:
    played = taking_turns(sides, max(1, steps // _STEPS_A_TURN), _STEPS_A_TURN)
    _check_same_places(played)
    wall = {name: float(np.median([turn.wall for turn in turns])) for name, turns in played.items()}
    processor = {name: float(np.median([turn.processor for turn in turns])) for name, turns in played.items()}
    ours = processor.pop("ours")
    return SimMeasured(
        wall,
        "control steps/s",
        f"median of the wall clock, LP_NUM_THREADS {os.environ.get('LP_NUM_THREADS', 'unset')}",
        {"processor_time_ratio": {peer: round(value / ours, 2) for peer, value in processor.items()}},
    )


def _check_same_places(played: dict[str, list[Turn]]) -> None:
    ours, *others = (np.array([turn.value for turn in turns]) for turns in played.values())
    for places in others:
        apart = np.abs(places - ours).max()
        if apart > 1e-3:
            raise SystemExit(f"the two simulations have parted by {apart:.1e} m: nothing to compare")
