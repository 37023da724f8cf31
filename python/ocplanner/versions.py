"""The dependency pins that matter at run time, checked when the simulator is first imported.

robosuite 1.5.2 asserts inside ``get_joint_qpos_addr`` with mujoco 3.10 and later, and needs NumPy 1.x. From mujoco
3.8 on the links of its Robotiq 85 gripper (UR5e, Kinova3) collide, so that it closes to 53 mm only. A newer version of
either breaks late and obscurely, so the package refuses to start and says what to install.
"""

import shlex
import sys
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

from ocplanner.errors import VersionError

PINS = {
    "robosuite": ((1, 5, 2), (1, 5, 3), "robosuite==1.5.2"),
    "mujoco": ((3, 3), (3, 8), "mujoco>=3.3,<3.8"),
    "numpy": ((1, 26), (2,), "numpy>=1.26,<2"),
}

REPORTED = ("ocplanner", "robosuite", "mujoco", "numpy", "torch", "gymnasium", "h5py")


def _release(version: str) -> tuple[int, ...]:
    """The leading numeric parts of a version: ``"3.10.0rc1"`` -> ``(3, 10, 0)``."""
    parts: list[int] = []
    for piece in version.split("."):
        digits = piece[: len(piece) - len(piece.lstrip("0123456789"))]
        if not digits:
            break
        parts.append(int(digits))
        if digits != piece:
            break
    return tuple(parts)


def check_pins() -> None:
    """Check every pin.

    Raises:
        VersionError: a pinned package is missing or outside its range; the message holds the ``pip`` line to run.
    """
    for package, (lowest, above, requirement) in PINS.items():
        check_pin(package, lowest, above, requirement)


def check_pin(package: str, lowest: tuple[int, ...], above: tuple[int, ...], requirement: str) -> None:
    """Check that a package's release lies in [lowest, above).

    Raises:
        VersionError: it is missing or does not; the message holds the ``pip`` line to run.
    """
    try:
        found = metadata.version(package)
    except metadata.PackageNotFoundError as error:
        raise VersionError(f"{package} is not installed; run: pip install '{requirement}'") from error
    if not lowest <= _release(found) < above:
        raise VersionError(
            f"{package} {found} is installed, but ocplanner needs {requirement}; run: pip install '{requirement}'"
        )


def running_command() -> str:
    """The command line that runs this process, as results record it; its words are quoted for a shell."""
    name = Path(sys.argv[0]).name if sys.argv else "ocplanner"
    return shlex.join([name, *sys.argv[1:]])


def installed() -> dict[str, str]:
    """Versions of the packages that results record; a package that is not installed is left out."""
    return dict(_installed())


@cache
def _installed() -> Mapping[str, str]:
    versions = {}
    for package in REPORTED:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions
