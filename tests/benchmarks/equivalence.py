"""How far the native control loop is from robosuite's own, arm by arm.

Run from the repository's root: ``python tests/benchmarks/equivalence.py``; it writes ``results/equivalence.json`` and
the table in ``docs/simulation.md``.

``torques``: in every substep of random control steps, the native loop and robosuite's controller compute torques from
the same state of the simulation; their largest and median difference, Nm, and in how many substeps it exceeds 1e-6.
After a reset robosuite computes the first substep from a mass matrix of before the reset; ocplanner takes over what it
remembers, so that substep counts too. ``rounding`` is the largest change of robosuite's own torques, in any substep,
when the last bit of each entry of the Jacobian is moved up or down at random (the worst of four draws): near a singular
pose its formulas amplify such a change as much as they amplify another order of additions.

``rollouts``: both loops run the same actions from the same start for ten seconds; the largest distance between the two
end effectors and between the two objects at any control step, m. With ``random`` all seven numbers of an action are
drawn uniformly from [-1, 1] at every step; with ``open`` and ``closed`` the gripper's command is held; ``holding``
starts with the hand at the object, closes, lifts and moves about. ``travel`` is how far the object comes. Where a
distance exceeds 1e-5 m, ``chaos`` is the distance between robosuite and robosuite started with one arm joint moved by
1e-15 rad: what rounding alone does to such a motion.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ocplanner import _core
from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.envs.robots import ROBOTS
from ocplanner.geometry.pose import Pose
from ocplanner.reproduction.markdown_tables import replace_tables
from ocplanner.versions import installed

_OUTPUT = Path("results/equivalence.json")
_PAGE = Path("docs/simulation.md")
_TASK = "Square"
_TOLERANCE_NM, _TOLERANCE_M = 1e-6, 1e-5
_DISTURBANCE_RAD = 1e-15
_SETTLING_STEPS, _CLOSING_STEPS = 6, 25
_ROUNDING_DRAWS = 4
_MOTIONS = ("random", "open", "closed", "holding")


class TorqueTwin:
    """Computes every torque of a stock environment natively too, from a copy of the same state.

    Attributes:
        differences: largest absolute difference in each substep so far, Nm.
        rounding: largest change of robosuite's own torques by the last bit of the Jacobian, Nm.
    """

    def __init__(self, env: ManipulationEnv) -> None:
        """Listens to ``env``, which must run robosuite's loop and have been reset."""
        self.differences: list[float] = []
        self.rounding: list[float] = []
        self._noise = np.random.default_rng(2)
        self._env = env
        self._robot: Any = env.robosuite_env.robots[0]
        self._arm = arm = self._robot.part_controllers["right"]
        self._data = mujoco.MjData(env.model)
        self._robosuites = arm.run_controller
        self._delta: np.ndarray | None = None
        site = env.sim.model.site_name2id
        self._loop = _core.ControlLoop(
            env.model,
            self._data,
            eef_site=site(arm.ref_name),
            base_site=site(f"{arm.naming_prefix}{arm.part_name}_center"),
            joint_qpos=arm.qpos_index,
            joint_qvel=arm.qvel_index,
            arm_actuators=self._robot._ref_actuators_indexes_dict["right"],
            gripper_actuators=self._robot._ref_actuators_indexes_dict["right_gripper"],
        )
        arm.run_controller = self._run

    def step(self, action: np.ndarray) -> None:
        """One control step of robosuite, compared in each of its substeps."""
        self._delta = self._arm.scale_action(action[:6])
        self._env.step(action)

    def _run(self) -> np.ndarray:
        arm, loop = self._arm, self._loop
        mujoco.mj_copyData(self._data, self._env.model, self._env.data)
        if not arm.new_update:
            velocity = np.concatenate((arm.ref_pos_vel, arm.ref_ori_vel))
            inertia = np.ascontiguousarray(arm.mass_matrix)
            loop.remember(arm.ref_pos, arm.ref_ori_mat, velocity, arm.J_full, inertia, arm.joint_pos, arm.joint_vel)
        torques = self._robosuites()
        if self._delta is not None:
            gripper = np.zeros(len(self._robot._ref_actuators_indexes_dict["right_gripper"]))
            loop.begin(self._delta, gripper, arm.kp, arm.kd, arm.initial_joint)
            self._delta = None
        loop.advance(1)
        self.differences.append(float(np.abs(loop.torques - torques).max()))
        self.rounding.append(
            max(float(np.abs(self._rounded_otherwise() - torques).max()) for _ in range(_ROUNDING_DRAWS))
        )
        arm.torques = torques
        return torques

    def _rounded_otherwise(self) -> np.ndarray:
        """robosuite's torques from the measurements that it has just used, but for the last bit of the Jacobian."""
        arm = self._arm
        names = ("J_full", "J_pos", "J_ori")
        measured = [getattr(arm, name) for name in names]
        toward = self._noise.choice([-np.inf, np.inf], arm.J_full.shape)
        moved = np.nextafter(arm.J_full, toward)
        arm.J_full, arm.J_pos, arm.J_ori = moved, moved[:3], moved[3:]
        arm.new_update = False  # else it would measure again
        torques = self._robosuites()
        for name, value in zip(names, measured):
            setattr(arm, name, value)
        return torques


def torque_difference(robot: str, steps: int) -> dict[str, float]:
    """Differences of the torques over random control steps, Nm."""
    with make_env(_TASK, robot, cameras=(), control="stock") as env:
        twin = TorqueTwin(env)
        rng = np.random.default_rng(1)
        for _ in range(steps):
            twin.step(rng.uniform(-1, 1, env.action_dim))
    assert len(twin.differences) == 25 * steps
    return {
        "largest": max(twin.differences),
        "substeps": len(twin.differences),
        "substeps_above_1e-6": sum(difference > _TOLERANCE_NM for difference in twin.differences),
        "median": float(np.median(twin.differences)),
        "rounding": max(twin.rounding),
    }


def rollout(env: ManipulationEnv, steps: int, motion: str, disturbance: float = 0.0) -> np.ndarray:
    """(steps, 2, 3) m: end effector and object after each control step; the same actions each time."""
    env.reset(4)
    if motion == "holding":
        _reach_for_the_object(env)
    env.data.qpos[env.robosuite_env.robots[0]._ref_joint_pos_indexes[0]] += disturbance
    return np.stack([_place_after(env, action) for action in _actions(motion, steps, env.action_dim)])


def _actions(motion: str, steps: int, length: int) -> np.ndarray:
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, length))
    if motion == "holding":
        actions *= 0.3
        actions[:_CLOSING_STEPS, :6] = 0
        actions[_CLOSING_STEPS : 2 * _CLOSING_STEPS, 2] = 0.3
    if motion != "random":
        actions[:, 6:] = -1 if motion == "open" else 1
    return actions


def _reach_for_the_object(env: ManipulationEnv) -> None:
    for _ in range(_SETTLING_STEPS):
        env.step(np.zeros(env.action_dim))
    grasp = env.object_pose() @ env.task.object().grasps[0].pose_object_eef
    env.place_eef(Pose(grasp.position, grasp.rotation @ env.robot.rotation_grasp_site))


def _place_after(env: ManipulationEnv, action: np.ndarray) -> np.ndarray:
    env.step(action)
    return np.stack([env.eef_pose().position, env.object_pose().position])


def apart(first: np.ndarray, second: np.ndarray) -> dict[str, float]:
    """Largest distance at any step, m."""
    distance = np.linalg.norm(first - second, axis=-1).max(axis=0)
    return {"end effector": float(distance[0]), "object": float(distance[1])}


def rollout_differences(robot: str, steps: int) -> dict[str, dict[str, Any]]:
    """By motion: native against stock, and stock against its disturbed self where that is large."""
    found: dict[str, dict[str, Any]] = {}
    with (
        make_env(_TASK, robot, cameras=(), control="stock") as stock,
        make_env(_TASK, robot, cameras=()) as native,
    ):
        if native.control != "native":
            raise SystemExit("the native control loop does not attach here: nothing to compare")
        for motion in _MOTIONS:
            expected = rollout(stock, steps, motion)
            travel = np.linalg.norm(expected[:, 1] - expected[0, 1], axis=-1).max()
            found[motion] = {"native": apart(rollout(native, steps, motion), expected), "travel": float(travel)}
            if max(found[motion]["native"].values()) > _TOLERANCE_M:
                found[motion]["chaos"] = apart(rollout(stock, steps, motion, _DISTURBANCE_RAD), expected)
    return found


def table(rows: list[dict[str, Any]]) -> str:
    """A Markdown table, one arm a row; where rounding alone parts robosuite from itself, that distance in brackets."""
    head = ["arm", "largest torque difference, Nm", "robosuite's own rounding, Nm", *_MOTIONS]
    lines = [f"| {' | '.join(head)} |", "| --- |" + " ---: |" * (len(head) - 1)]
    for row in rows:
        torques = row["torques"]
        cells = [row["robot"], f"{torques['largest']:.0e}", f"{torques['rounding']:.0e}"]
        for motion in _MOTIONS:
            found = row["rollouts"][motion]
            chaos = f" ({max(found['chaos'].values()):.0e})" if "chaos" in found else ""
            cells.append(f"{max(found['native'].values()):.0e}{chaos}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Compare the arms asked for and write what was found beside the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="*", choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument("--torque-steps", type=int, default=500)
    parser.add_argument("--rollout-steps", type=int, default=200)
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    rows = []
    for robot in options.robots:
        torques = torque_difference(robot, options.torque_steps)
        rollouts = rollout_differences(robot, options.rollout_steps)
        rows.append({"robot": robot, "torques": torques, "rollouts": rollouts})
        print(json.dumps(rows[-1]), flush=True)  # noqa: T201
    earlier = json.loads(options.output.read_text())["rows"] if options.output.exists() else []
    merged = {row["robot"]: row for row in [*earlier, *rows]}
    result = {
        "command": f"python tests/benchmarks/equivalence.py --torque-steps {options.torque_steps}"
        f" --rollout-steps {options.rollout_steps}",
        "task": _TASK,
        "units": {"torques": "Nm", "rollouts": "m"},
        "versions": installed(),
        "rows": list(merged.values()),
    }
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(result, indent=1) + "\n")
    if options.output == _OUTPUT:
        _PAGE.write_text(replace_tables(_PAGE.read_text(), {"EQUIVALENCE": table(result["rows"])}, _PAGE))


if __name__ == "__main__":
    main()
