"""Types of the native module. It reads arrays as NumPy views, without copying, and returns new arrays."""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ControlLoop",
    "DeltaPoseBatch",
    "DeltaPoseController",
    "DeltaPoseLaw",
    "PlannerEngine",
    "RewardLaw",
    "delta_pose_action",
    "geodesic_angle",
    "quat_wxyz_from_rotation",
    "quat_xyzw_from_rotation",
    "rotation_exp",
    "rotation_from_6d",
    "rotation_from_quat_wxyz",
    "rotation_from_quat_xyzw",
    "rotation_log",
    "rotation_to_6d",
    "simd_level",
]

_F64: TypeAlias = NDArray[np.float64]
_Pose: TypeAlias = tuple[_F64, _F64]
_Poses: TypeAlias = tuple[_F64, _F64 | None]
_Terms: TypeAlias = tuple[_F64, _F64 | None, _F64]

def rotation_from_6d(rot6d: _F64) -> _F64:
    """(..., 6) columns a1, a2 (Zhou et al. 2019) -> (..., 3, 3) rotations.

    Raises:
        InvalidValueError: a column is zero, not finite, or parallel to the other.
        ShapeError: wrong shape, dtype or memory order. All functions below raise it too.
    """

def rotation_to_6d(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 6), their first two columns."""

def rotation_from_quat_xyzw(quat_xyzw: _F64) -> _F64:
    """(..., 4) quaternions x, y, z, w of any length but zero -> (..., 3, 3) rotations.

    Equal to the textbook formula in NumPy to the last bit.

    Raises:
        InvalidValueError: a quaternion is zero or not finite.
    """

def quat_xyzw_from_rotation(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 4) unit quaternions x, y, z, w with w >= 0."""

def rotation_from_quat_wxyz(quat_wxyz: _F64) -> _F64:
    """As :func:`rotation_from_quat_xyzw`, for quaternions in MuJoCo's order w, x, y, z."""

def quat_wxyz_from_rotation(rotation: _F64) -> _F64:
    """As :func:`quat_xyzw_from_rotation`, in MuJoCo's order w, x, y, z."""

def rotation_log(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 3) rotation vectors, axis times angle in [0, pi] rad."""

def rotation_exp(vector: _F64) -> _F64:
    """(..., 3) rotation vectors, axis times angle in rad -> (..., 3, 3) rotations."""

def geodesic_angle(a: _F64, b: _F64) -> _F64:
    """Angles (...) in [0, pi] rad between two arrays of rotations (..., 3, 3)."""

@final
class PlannerEngine:
    """Runs a planner file. Several threads may call it at once."""

    def __new__(cls, data: bytes, storage: Literal["f32", "bf16"] = "f32") -> PlannerEngine:
        """Load the bytes of a planner file. ``storage`` keeps the weights as float32 or rounds them to bfloat16.

        Raises:
            ModelFileError: the bytes are damaged or are not a planner file.
            UnknownNameError: an unknown storage.
        """

    @property
    def config_json(self) -> str:
        """The file's whole configuration, JSON."""

    def plan(
        self, images: list[NDArray[np.uint8]], *, all_modes: bool = False, threads: int = 1, steps: int | None = None
    ) -> tuple[_F64, _F64 | None, _F64]:
        """Plan from one (B, size, size, 3) uint8 array per camera, in the configuration's order.

        Args:
            images: upright RGB.
            all_modes: plan with every mode, in the network's order, instead of each image's most probable one.
            threads: threads to which the batch is dealt out.
            steps: decode only so many of the H steps.

        Returns:
            positions (B, H, 3) in m, rotations (B, H, 3, 3) or None, probabilities (B,). With ``all_modes`` each has
            a second axis, the modes; with ``steps`` that is H.

        Raises:
            InvalidValueError: ``steps`` is zero or beyond the planner's horizon, or the weights overflow on an image.
            ShapeError: an array has the wrong shape, dtype or memory order.
        """

    def encode(self, images: list[NDArray[np.uint8]], threads: int = 1) -> NDArray[np.float32]:
        """Latent means (B, latent) of each image's most probable mode."""

@final
class RewardLaw:
    """Rewards of an episode's transitions from E = a |p' - p|^2 + b |r' - r|^2, the distance from the plan.

    p is a position in m, r the first two columns of a rotation matrix. ``form`` is ``"penalty"`` (-E),
    ``"literal"`` (+E, as the paper prints it), ``"exp"`` (exp(-E / ``scale``)) or ``"potential"`` (shaping by the
    potential -E, with discount ``gamma``).

    Raises:
        InvalidValueError: a weight is negative, or the form's scale or discount is outside its range.
        UnknownNameError: an unknown form.
    """

    def __new__(
        cls,
        form: str = "penalty",
        *,
        weight_position: float = 0.003,
        weight_rotation: float = 0.003,
        scale: float = 2.5e-4,
        gamma: float = 0.99,
    ) -> RewardLaw: ...
    def rewards(
        self,
        planned: _Poses,
        achieved: _Poses,
        grasping: NDArray[np.bool_],
        *,
        further: _F64 | None = None,
        terminal: bool = True,
    ) -> _Terms:
        """Position term (T,) in m^2, rotation term (T,) or None, both unweighted, and reward (T,).

        Args:
            planned: ((T, 3), (T, 3, 3) or None) m'_{t+1}, world frame, m.
            achieved: m_{t+1} likewise.
            grasping: (T,), whether the object is held.
            further: (T,) weighted error of terms beside these two; E includes it where the object is held.
            terminal: the last transition leads to a terminal state; otherwise a time limit cuts the episode off.

        Raises:
            InvalidValueError: a number is not finite, a matrix is not a rotation, or a reward overflows.
            ShapeError: wrong shape, dtype or memory order.
        """

def simd_level() -> Literal["avx512", "avx2", "portable"]:
    """The instruction set in use, for benchmarks and bug reports.

    The environment variable ``OCPLANNER_SIMD`` selects a lower one, if it is set before the first planner is loaded.
    """

@final
class ControlLoop:
    """One arm's robosuite control step (OSC_POSE) inside MuJoCo, without the GIL.

    A control step is :meth:`begin` (the first physics substep up to the actuators' commands) and then :meth:`advance`
    (the rest). As with ``mujoco.mj_step``, the caller must not step the same data from another thread meanwhile.
    """

    def __new__(
        cls,
        model: Any,
        data: Any,
        *,
        eef_site: int,
        base_site: int,
        joint_qpos: Sequence[int],
        joint_qvel: Sequence[int],
        arm_actuators: Sequence[int],
        gripper_actuators: Sequence[int],
        world_frame: bool = False,
        uncouple: bool = True,
        lite_physics: bool = True,
    ) -> ControlLoop:
        """Bind to an ``MjModel`` and its ``MjData``; sites, joints and actuators are MuJoCo's indices.

        Args:
            model: a ``mujoco.MjModel``.
            data: its ``mujoco.MjData``.
            eef_site: the controlled site.
            base_site: the site in whose frame actions are expressed.
            joint_qpos: the arm's joints in ``qpos``, at most 8.
            joint_qvel: the same joints in ``qvel``.
            arm_actuators: the joints' torque actuators.
            gripper_actuators: the gripper's actuators, at most 16.
            world_frame: actions are expressed in the world frame instead of the base site's.
            uncouple: position and orientation are controlled as if they did not couple.
            lite_physics: ``mj_step1`` and ``mj_step2`` around the controller, otherwise ``mj_forward`` and ``mj_step``.

        Raises:
            InvalidValueError: an index is outside its array, or the data belong to another model.
            ShapeError: the lists of joints differ in length.
            VersionError: the loaded MuJoCo library is not found, or its version is not the module's.
        """

    def add(self, other: ControlLoop) -> None:
        """Run the loop of another arm on the same data together with this one from now on.

        In each control step :meth:`begin` this loop, then the others, then :meth:`advance` this one alone.

        Raises:
            InvalidValueError: the other loop's data differ, it is this loop, one of the two was added to a loop
                before, the other has loops of its own, or ``lite_physics`` is off.
        """

    def begin(self, delta: _F64, gripper: _F64, stiffness: _F64, damping: _F64, posture: _F64) -> None:
        """Set a goal that lies ``delta`` away, and the first commands.

        Args:
            delta: (6,) m, then axis times angle in rad.
            gripper: (gripper actuators,) commands, clipped to their control range.
            stiffness: (6,) 1/s^2.
            damping: (6,) 1/s.
            posture: (joints,) the joint positions toward which the null space moves, rad.

        Raises:
            InvalidValueError: a number is not finite.
            ShapeError: wrong shape, dtype or memory order.
        """

    def advance(self, substeps: int) -> None:
        """Run physics substeps, including the one begun, of this arm and of those added to it.

        Raises:
            InvalidValueError: one of them has not begun a control step, or this loop was added to another.
        """

    def measured(self) -> tuple[_F64, _F64, _F64, _F64, _F64, _F64, _F64]:
        """The controller's last measurement.

        The end effector's position (3,) m, rotation (3, 3) and velocity (6,), world frame; its Jacobian (6, joints);
        the inertia (joints, joints); the joints' positions and velocities (joints,).
        """

    def remember(
        self,
        position: _F64,
        rotation: _F64,
        velocity: _F64,
        jacobian: _F64,
        inertia: _F64,
        joint_position: _F64,
        joint_velocity: _F64,
    ) -> None:
        """Make the next :meth:`begin` use this measurement, as :meth:`measured` returns it, not the simulation's.

        Raises:
            InvalidValueError: a number is not finite.
            ShapeError: wrong shape, dtype or memory order.
        """

    @property
    def goal_position(self) -> _F64:
        """(3,) m, in the actions' frame."""

    @property
    def goal_rotation(self) -> _F64:
        """(3, 3), end effector -> the actions' frame."""

    @property
    def torques(self) -> _F64:
        """(joints,) N m, the last ones computed, with gravity compensation, before clipping."""

@final
class DeltaPoseLaw:
    """How a pose difference becomes a normalised OSC_POSE action.

    Gains multiply the differences. A command is clipped to ``limit_horizontal`` (m, the length in xy),
    ``limit_vertical`` (m) and ``limit_rotation`` (rad) a step, and divided by the controller's output scales (m, rad).

    Raises:
        InvalidValueError: a number is not positive, or a limit exceeds its scale.
    """

    def __new__(
        cls,
        *,
        gain_position: float = 1.0,
        gain_rotation: float = 1.0,
        limit_horizontal: float = 0.05,
        limit_vertical: float = 0.05,
        limit_rotation: float = 0.2,
        scale_position: float = 0.05,
        scale_rotation: float = 0.5,
    ) -> DeltaPoseLaw: ...

def delta_pose_action(
    pose_object: _Pose, pose_target: _Pose, pose_eef: _Pose, rotation_world_base: _F64, law: DeltaPoseLaw | None = None
) -> _F64:
    """(..., 6) actions in [-1, 1] that move rigidly held objects toward target poses.

    All arguments have the same leading axes: none for a single environment, one for a batch. Any memory order will do.

    Args:
        pose_object: ((..., 3), (..., 3, 3)) the object's pose, world frame, metres.
        pose_target: its target pose.
        pose_eef: pose of the end-effector site.
        rotation_world_base: (..., 3, 3) base frame -> world; the action is in the base frame.
        law: gains and limits.

    Raises:
        InvalidValueError: a number is not finite, a matrix is not a rotation, or the poses are too far apart.
        ShapeError: wrong shape or dtype.
    """

@final
class DeltaPoseController:
    """Follows one plan at a time: says at which pose to aim the object; :func:`delta_pose_action` moves it there.

    ``follow`` is ``"open-loop"`` (the paper's control: differences of consecutive planned poses), ``"time"`` (closed
    loop, one plan step a control step) or ``"gated"`` (closed loop; starts at the nearest plan step and advances while
    the object is within ``gate_position`` m and ``gate_rotation`` rad of the target).

    Raises:
        InvalidValueError: an unknown mode, or a gate that is not positive.
    """

    def __new__(
        cls, follow: str = "gated", *, gate_position: float = 0.025, gate_rotation: float = 0.2
    ) -> DeltaPoseController: ...
    def set_plan(self, positions: _F64, rotations: _F64 | None, pose_object: _Pose) -> None:
        """Take (H, 3) planned positions, m, and (H, 3, 3) rotations, or None, and the object's present pose.

        Raises:
            InvalidValueError: a number is not finite, or a matrix is not a rotation.
            ShapeError: wrong shape, or an empty plan.
        """

    def target(self, pose_object: _Pose) -> _Pose:
        """Advance along the plan, and return the pose at which to aim the object now.

        Raises:
            InvalidValueError: there is no plan yet.
        """

    @property
    def index(self) -> int:
        """The plan step that is the target now, to draw or log the progress."""

    @property
    def at_end(self) -> bool:
        """Whether the target is the last step: time for a new plan."""

@final
class DeltaPoseBatch:
    """A :class:`DeltaPoseController` for each of B environments, for simulators that step many environments at once.

    Raises:
        InvalidValueError: an unknown mode, a gate that is not positive, or more than 65,536 environments.
    """

    def __new__(
        cls, environments: int, follow: str = "gated", *, gate_position: float = 0.025, gate_rotation: float = 0.2
    ) -> DeltaPoseBatch: ...
    def set_plans(
        self,
        positions: _F64,
        rotations: _F64 | None,
        pose_object: _Pose,
        chosen: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take plans as a planner gives them: (B, H, 3) positions, m, and (B, H, 3, 3) rotations, or None.

        ``pose_object`` holds the objects' present poses, ((B, 3), (B, 3, 3)). With ``chosen`` (B,) only those
        environments take a new plan. The others keep theirs, as all do after an error.

        Raises:
            InvalidValueError: a number is not finite, or a matrix is not a rotation.
            ShapeError: wrong shape or dtype, or empty plans.
        """

    def targets(self, pose_object: _Pose) -> _Pose:
        """Advance along every plan, and return the ((B, 3), (B, 3, 3)) poses at which to aim the objects now.

        Raises:
            InvalidValueError: an environment has no plan, a number is not finite, or a matrix is not a rotation.
            ShapeError: wrong shape or dtype.
        """

    @property
    def index(self) -> NDArray[np.uint64]:
        """(B,) plan steps that are the targets now."""

    @property
    def at_end(self) -> NDArray[np.bool_]:
        """(B,) whether the targets are the last steps: time for new plans."""
