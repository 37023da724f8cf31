"""Plan and act as on a robot's computer: beside the package, only numpy, h5py and safetensors are installed."""

import os
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

TESTS = Path(__file__).parents[1]
PLANNER = TESTS.parent / "results" / "planners" / "square_masked_h20_pose_0.safetensors"
NEEDED = ("h5py", "numpy", "safetensors")
PROGRAM = """
import importlib, pkgutil, sys
from importlib import metadata
import numpy as np
import ocplanner

planner, tests = sys.argv[1:]
there = {package.metadata["Name"] for package in metadata.distributions()} - {"ocplanner"}
assert there == {"h5py", "numpy", "safetensors"}, there

plan = ocplanner.Planner.load(planner).plan({"agentview": np.zeros((2, 84, 84, 3), np.uint8)})
assert plan.position.shape == (2, 20, 3) and plan.rotation.shape == (2, 20, 3, 3)

for room in ("control", "files", "geometry"):
    package = importlib.import_module(f"ocplanner.{room}")
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)

sys.path.append(tests)
from floating_cell import DOWN, FLOOR, FloatingCell, Toward
from ocplanner.control.executor import Executor
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.tasks import ObjectSpec
from ocplanner.envs.tasks.task import top_grasp
from ocplanner.geometry.pose import Pose

cube = ObjectSpec("cube", "cube_joint", (top_grasp("top", (0.0, 0.0, 0.0)),), yaw_fold=0)
lying, home = Pose(np.array([0.0, 0.05, FLOOR]), np.eye(3)), Pose(np.array([0.0, -0.3, 1.1]), DOWN)
cell = FloatingCell({"cube": (cube, lying)}, [home])
planners = {"cube": Toward(cell, "cube", np.array([0.15, -0.2, FLOOR + 0.01]))}
executor = Executor(cell, [cube], planners, dict, ControlSettings(), horizon=600)
executor.run()
assert executor.finished
print("planned, and placed a cube")
"""


def plan_and_act(folder: Path, package: Path) -> str:
    """Make the environment in ``folder``, plan with a committed planner and place an object there.

    Args:
        folder: where the environment goes.
        package: the wheel, or the folder that holds the sources of ``ocplanner`` with its compiled core.

    Returns:
        What the program printed.

    Raises:
        subprocess.CalledProcessError: something that planning or control needs is missing.
    """
    uv = shutil.which("uv") or str(Path(sys.executable).with_name("uv"))
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    python = folder / "bin" / "python"

    def run(*command: str | Path) -> str:
        return subprocess.run(
            command, env=clean, check=True, stdout=subprocess.PIPE, text=True, cwd=folder.parent
        ).stdout

    run(uv, "venv", "--quiet", "--python", sys.executable, folder)
    install = (uv, "pip", "install", "--quiet", "--python", python)
    pins = [f"{name}=={metadata.version(name)}" for name in NEEDED]
    try:
        run(*install, "--offline", *pins)  # `make setup` has put them into uv's cache
    except subprocess.CalledProcessError:
        run(*install, *pins)
    if package.is_dir():
        next(folder.glob("lib/python*/site-packages")).joinpath("sources.pth").write_text(f"{package}\n")
    else:
        run(*install, "--no-deps", package)
    return run(python, "-c", PROGRAM, PLANNER, TESTS)
