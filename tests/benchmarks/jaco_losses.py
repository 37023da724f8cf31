"""What touches the nut before Jaco loses it.

``python tests/benchmarks/jaco_losses.py``

Episodes of Square, as in a transfer. For each time that the held nut was lost: the phase, and how hard the peg or
anything else but the hand pushed it in the last steps before.
"""

import argparse
import shlex
import sys
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np

from ocplanner.envs.environment import ManipulationEnv
from ocplanner.files.storage import atomic_json
from ocplanner.versions import installed
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup

FIRST_SEED = 500
LAST_STEPS = 12
HELD = ("lift", "transit", "align", "lower", "unstick")


def push(env: ManipulationEnv, nut: np.ndarray) -> float:
    """Sum of the normal forces on the nut of what is not the hand, N.

    Args:
        env: the arm before its task.
        nut: (ngeom,) bool, the nut's geoms.
    """
    force, total = np.zeros(6), 0.0
    for number in range(env.data.ncon):
        first, second = env.data.contact.geom[number]
        if nut[first] == nut[second]:
            continue
        other = env.model.geom_bodyid[second if nut[first] else first]
        if not env.model.body(other).name.startswith("gripper0"):
            mujoco.mj_contactForce(env.model, env.data, number, force)
            total += float(force[0])
    return total


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planner", type=Path, default=Path("results/planners/square_masked_h20_pose_0.safetensors"))
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("results/jaco_losses.json"))
    options = parser.parse_args()
    runner, rows, ends = EpisodeRunner(TransferSetup.of(options.planner, "Jaco")), [], Counter()
    env = runner.env
    root = env.model.body("SquareNut_main").id
    nut = env.model.body_rootid[env.model.geom_bodyid] == root
    pushes: list[float] = []

    def note() -> None:
        pushes.append(push(env, nut))

    try:
        for seed in range(FIRST_SEED, FIRST_SEED + options.episodes):
            pushes.clear()
            episode = runner.run(seed, note)
            ends[episode.failure or "success"] += 1
            phases = episode.trace.phases
            for step in range(1, len(phases)):
                if phases[step] == "recover" and phases[step - 1] in HELD:
                    hardest = max(pushes[max(0, step - LAST_STEPS) : step])
                    rows.append({"seed": seed, "step": step, "phase": phases[step - 1], "push_n": round(hardest, 1)})
                    print(rows[-1], flush=True)  # noqa: T201
    finally:
        runner.close()
    command = shlex.join(["python", "tests/benchmarks/jaco_losses.py", *sys.argv[1:]])
    content = {"command": command, "first_seed": FIRST_SEED, "episodes": dict(ends), "versions": installed()}
    atomic_json(options.out, {**content, "losses": rows})


if __name__ == "__main__":
    main()
