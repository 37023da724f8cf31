"""Versions of other packages: those that results record, and those that the simulator depends on.

With a wrong robosuite, mujoco or NumPy the simulator fails late and obscurely. So the first import of the simulator
checks them against the requirements of the installed ocplanner, which come from ``pyproject.toml``;
``CONTRIBUTING.md`` gives the reason for each.
"""

import shlex
import sys
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from ocplanner.errors import VersionError

PINNED = ("robosuite", "mujoco", "numpy")
"""What :func:`check_pins` checks."""

REPORTED = ("ocplanner", "robosuite", "mujoco", "numpy", "torch", "gymnasium", "h5py")
"""What :func:`installed` reports."""


def check_pins() -> None:
    """Check the packages that the simulator depends on.

    Raises:
        VersionError: as :func:`check_pin`.
    """
    for package in PINNED:
        check_pin(package)


def check_pin(package: str) -> None:
    """Check the installed version of a package that ocplanner or one of its extras requires.

    Raises:
        VersionError: the package is missing or has a version that ocplanner does not allow, or ocplanner itself is not
            installed; the message holds the ``pip`` command to run.
    """
    try:
        required = metadata.requires("ocplanner") or []
    except metadata.PackageNotFoundError as error:
        raise VersionError("ocplanner is not installed; run: pip install . (in its source folder)") from error
    text = next(text for text in required if Requirement(text).name == package).partition(";")[0].strip()
    remedy = f"run: pip install '{text}'"
    try:
        found = metadata.version(package)
    except metadata.PackageNotFoundError as error:
        raise VersionError(f"{package} is not installed; {remedy}") from error
    if not Requirement(text).specifier.contains(found, prereleases=True):
        raise VersionError(f"{package} {found} is installed, but ocplanner needs {text}; {remedy}")


def running_command() -> str:
    """The command line that runs this process, as results record it; its words are quoted for a shell."""
    name = Path(sys.argv[0]).name if sys.argv else "ocplanner"
    return shlex.join([name, *sys.argv[1:]])


def installed() -> dict[str, str]:
    """The versions of the packages that results record, without those that are not installed."""
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
