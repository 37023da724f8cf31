"""How well policies carry an object that another policy took: what hints, which begin at the grasp, can change at all.

``python tests/benchmarks/after_grasp.py --grasp runs/reproduce/bc_state_original_2/policies/step_0012000.safetensors
--carry runs/a/policy.safetensors runs/b/policy.safetensors``

In each episode the first policy, from states, acts until the object is held and whenever it is not; the one that is
measured acts while it is. Until the first hold, episodes are the same for every policy.
"""

import argparse
import json
import shlex
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import torch

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.envs.environment import make_env
from ocplanner.files.records.render import RenderRecord
from ocplanner.files.storage import atomic_json
from ocplanner.guidance.live_hint import LiveHint
from ocplanner.planner.planner import Planner
from ocplanner.policies.policy import Policy
from ocplanner.policies.rollout import PolicyRollout
from ocplanner.rollouts.intervals import wilson
from ocplanner.versions import installed

FIRST_SEED = 50000


def relay(grasp: PolicyRollout, carry: PolicyRollout, seed: int, horizon: int) -> str | None:
    """One episode: ``success``, ``lost`` or ``held at the end``; None if the object was never held."""
    env = carry.env
    env.reset(seed)
    grasp.policy.reset(seed)
    carry.policy.reset(seed)
    gripper, hold, held, ever = -1.0, GraspDetector(), False, False
    for _ in range(horizon):
        held = hold.update(env.object_pose(), env.eef_pose().position, gripper)
        ever = ever or held
        acting = carry if held else grasp
        action = acting.policy.act(acting._observation(held))[0]
        env.step(acting._carried_out(action))
        gripper = float(action[-1])
        if env.success():
            return "success" if ever else None
    return None if not ever else "held at the end" if held else "lost"


def measure(grasp: Path, carry: Path, planner: Planner, episodes: int, horizon: int) -> dict[str, Any]:
    """Outcomes of one policy's episodes."""
    policy = Policy.load(carry)
    seen, render = policy.training.observation, policy.header.render or RenderRecord()
    visual, observe = render.visual or "fast", render.observe
    task, robot = policy.header.task, policy.header.robots[0]
    with make_env(task, robot, cameras=seen.cameras, image_size=seen.image_size, visual=visual, observe=observe) as env:
        hint = LiveHint(env, planner, policy.header.labels) if policy.training.reads_hints else None
        rollouts = PolicyRollout(env, Policy.load(grasp)), PolicyRollout(env, policy, hint)
        seeds = range(FIRST_SEED, FIRST_SEED + episodes)
        outcomes = Counter(relay(*rollouts, seed, horizon) for seed in seeds)
    outcomes.pop(None, None)
    held = sum(outcomes.values())
    return {
        "policy": str(carry),
        "hint": policy.header.training["network"]["hint"],
        "low_dim": list(seen.low_dim),
        "cameras": list(seen.cameras),
        "held": held,
        "outcomes": dict(outcomes),
        "success_of_held": [outcomes["success"] / max(held, 1), *wilson(outcomes["success"], max(held, 1))],
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grasp", type=Path, required=True, help="policy file that takes the object, from states")
    parser.add_argument("--carry", type=Path, nargs="+", required=True, help="policy files to measure")
    parser.add_argument(
        "--planner",
        type=Path,
        default=Path("results/planners/square_masked_h20_pose_0.safetensors"),
        help="of the hints",
    )
    parser.add_argument("--episodes", type=int, default=60)
    parser.add_argument("--horizon", type=int, default=400)
    parser.add_argument("--out", type=Path, default=Path("results/after_grasp.json"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    planner, rows = Planner.load(options.planner), []
    for carry in options.carry:
        rows.append(measure(options.grasp, carry, planner, options.episodes, options.horizon))
        print(json.dumps(rows[-1]), flush=True)  # noqa: T201
        result = {
            "command": shlex.join(["python", "tests/benchmarks/after_grasp.py", *sys.argv[1:]]),
            "grasp": str(options.grasp),
            "first_seed": FIRST_SEED,
            "episodes": options.episodes,
            "versions": installed(),
            "rows": rows,
        }
        atomic_json(options.out, result)


if __name__ == "__main__":
    main()
