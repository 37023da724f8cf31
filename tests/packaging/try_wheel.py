"""Install a wheel into an empty environment outside the source tree and run the README's Python example there.

``python tests/packaging/try_wheel.py WHEEL [--oldest]``. The example runs with a committed planner, a tiny data set and
two episodes in place of fifty; nothing else in it is changed. Then the wheel is tried without its simulator.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from robot_computer import plan_and_act

ROOT = Path(__file__).parents[2]
PLANNER = ROOT / "results" / "planners" / "square_masked_h20_pose_0.safetensors"
CHECKS = """
import math, sys
from pathlib import Path
assert Path(ocp.__file__).is_relative_to(sys.prefix), f"{ocp.__file__} is not of this environment"
assert plan.position.shape == (1, 20, 3) and plan.rotation.shape == (1, 20, 3, 3)
assert len(result.runs) == 2 and len(demos) == 4
print(result)
"""


def example(readme: str, data: Path) -> str:
    """The README's Python example on our files, with checks of what it made.

    Raises:
        ValueError: the README no longer holds what is replaced.
    """
    blocks = re.findall(r"^```python\n(.*?)^```", readme, flags=re.DOTALL | re.MULTILINE)
    if len(blocks) != 1:
        raise ValueError(f"README.md has {len(blocks)} Python examples, expected one")
    code = blocks[0]
    for theirs, ours in (
        ('"runs/square/planner.safetensors"', repr(str(PLANNER))),
        ('"square_ph.hdf5"', repr(str(data))),
        ("episodes=50", "episodes=2"),
    ):
        if theirs not in code:
            raise ValueError(f"the Python example in README.md has no {theirs}")
        code = code.replace(theirs, ours)
    return code + CHECKS


def tiny_data(path: Path) -> None:
    """Write the tests' synthetic demonstrations."""
    sys.path.insert(0, str(ROOT / "tests"))
    from conftest import _write_tiny_square

    _write_tiny_square(path, "1.4.1", images=False)


def main(arguments: Sequence[str] | None = None) -> None:
    """Install, run, and say what was done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--oldest", action="store_true", help="with the oldest dependencies that pyproject.toml allows")
    options = parser.parse_args(arguments)
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    environment = {**clean, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    with tempfile.TemporaryDirectory(prefix="wheel-") as folder:

        def run(*command: str | Path) -> None:
            subprocess.run(command, cwd=folder, env=environment, check=True)

        python = Path(folder, "environment", "bin", "python")
        run("uv", "venv", "--quiet", "--python", sys.executable, "environment")
        install = ("uv", "pip", "install", "--quiet", "--python", python)
        if options.oldest:
            run(*install, "--resolution", "lowest-direct", "--requirement", ROOT / "pyproject.toml")
            run(*install, "--no-deps", options.wheel.resolve())
            run("uv", "pip", "list", "--python", python)
        else:
            run(*install, options.wheel.resolve())
        data = Path(folder, "tiny.hdf5")
        tiny_data(data)
        script = Path(folder, "example.py")
        script.write_text(example((ROOT / "README.md").read_text(encoding="utf-8"), data), encoding="utf-8")
        run(python, script)
        run(python.with_name("ocplanner"), "info", data)
        sys.stdout.write(plan_and_act(Path(folder, "robot"), options.wheel.resolve()))


if __name__ == "__main__":
    main()
