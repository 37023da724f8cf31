"""The versions that the simulator needs."""

import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from ocplanner import versions
from ocplanner.errors import VersionError


@pytest.mark.parametrize(
    ("package", "version"),
    [
        ("mujoco", "3.8.0"),
        ("mujoco", "3.8.0rc1"),
        ("mujoco", "3.10.0"),
        ("mujoco", "4.0.0"),
        ("numpy", "2.1.0"),
        ("robosuite", "1.4.1"),
    ],
)
def test_a_version_outside_its_pin_names_what_to_install(monkeypatch, package: str, version: str) -> None:
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: version if name == package else real(name))
    with pytest.raises(VersionError, match=rf"{package} {version} is installed.*pip install '{package}"):
        versions.check_pins()


@pytest.mark.parametrize(("package", "version"), [("mujoco", "3.7.1rc1"), ("numpy", "1.26.4+local")])
def test_a_version_inside_its_pin_passes(monkeypatch, package: str, version: str) -> None:
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: version if name == package else real(name))
    versions.check_pins()


@pytest.mark.parametrize("package", versions.PINNED)
def test_a_pin_is_what_pyproject_says(monkeypatch, package: str) -> None:
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    (required,) = [text for text in project["dependencies"] if text.startswith(package)]
    monkeypatch.setattr(metadata, "version", lambda _: "0.1")
    with pytest.raises(VersionError, match=re.escape(f"ocplanner needs {required}; run: pip install '{required}'")):
        versions.check_pin(package)


def test_a_missing_package_names_what_to_install(monkeypatch) -> None:
    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", missing)
    with pytest.raises(VersionError, match=r"robosuite is not installed; run: pip install 'robosuite==1\.5\.2'"):
        versions.check_pins()


@pytest.mark.parametrize("loaded", ["ocplanner", "ocplanner.cli; ocplanner.cli._commands()"])
def test_neither_the_import_nor_the_verbs_help_loads_torch_or_robosuite(loaded: str) -> None:
    code = f"import sys, {loaded}; print('torch' in sys.modules, 'robosuite' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
