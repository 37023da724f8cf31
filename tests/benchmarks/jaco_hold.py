"""How firmly Jaco's hand holds the cube, the can and the nut, by how long it squeezes and how the hand is turned.

``python tests/benchmarks/jaco_hold.py``

Each is taken as in a transfer, once, lifted by 12 cm, carried by 14 cm while it turns by 0.8 rad, and lowered by 6 cm.
No horizon and no planner: what is measured is the hand. ``None`` steps: told to close all along, as other grippers are.
A turn of 0 rad: the hand's closing axis, not the line along which the two fingers meet, lies across the object.
"""

import argparse
import shlex
import sys
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from ocplanner import _core
from ocplanner.control.arm_program import ArmProgram
from ocplanner.control.grasp import is_held, take_hold
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.environment import ManipulationEnv, make_env
from ocplanner.envs.robots import RobotSpec, robot
from ocplanner.files.storage import atomic_json
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation
from ocplanner.versions import installed

FIRST_SEED = 500
STEPS = 80


def carry(env: ManipulationEnv, arm: RobotSpec, seed: int) -> tuple[str, float]:
    """How the carry ended, and how far the grip point had wandered on the object, metres."""
    settings = ControlSettings()
    env.reset(seed)
    law = _core.DeltaPoseLaw(gain_position=settings.gain, gain_rotation=settings.gain)
    body = ArmProgram(env, law, 10_000, holding=arm.holding)
    taken = take_hold(body, env.task.object(), arm, settings.grasp, env.arms[0].reach)
    if taken is None:
        return "not taken", 0.0
    start = env.object_pose()
    top = Pose(start.position + np.array([-0.08, 0.12, 0.12]), start.rotation @ yaw_rotation(0.8))
    now = body.read()
    for name, target in (("lift", start.raised(0.12)), ("carry", top), ("lower", top.raised(-0.06))):
        for _ in range(STEPS):
            now = body.move_object(target)
            if not is_held(now, taken, settings.grasp):
                return f"lost: {name}", float(np.linalg.norm(now.grip_point - taken))
    return "held", float(np.linalg.norm(now.grip_point - taken))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--squeeze", nargs="+", default=["None", "16", "36", "48"], help="control steps")
    parser.add_argument("--turn", nargs="+", type=float, default=[0.0, robot("Jaco").turn], help="radians")
    parser.add_argument("--tasks", nargs="+", default=["Lift", "Can", "Square"])
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("results/jaco_hold.json"))
    options = parser.parse_args()
    arm, rows = robot("Jaco"), []
    for task in options.tasks:
        with make_env(task, arm, cameras=()) as env:
            for squeeze, turn in product(options.squeeze, options.turn):
                steps = None if squeeze == "None" else int(squeeze)
                hand = replace(arm, turn=turn)
                hand = replace(hand, holding=1.0) if steps is None else replace(hand, squeeze_steps=steps)
                ends = [carry(env, hand, FIRST_SEED + number) for number in range(options.episodes)]
                wandered = [distance for end, distance in ends if end == "held"]
                row = {
                    "task": task,
                    "squeeze_steps": steps,
                    "turn_rad": turn,
                    "ends": dict(Counter(end for end, _ in ends)),
                    "median_drift_mm": round(1000 * float(np.median(wandered)), 1) if wandered else None,
                }
                rows.append(row)
                print(row, flush=True)  # noqa: T201
    command = shlex.join(["python", "tests/benchmarks/jaco_hold.py", *sys.argv[1:]])
    content = {"command": command, "first_seed": FIRST_SEED, "episodes": options.episodes, "versions": installed()}
    atomic_json(options.out, {**content, "rows": rows})


if __name__ == "__main__":
    main()
