"""The import-time pins."""

import subprocess
import sys
from importlib import metadata

import pytest

from ocplanner import versions
from ocplanner.errors import VersionError


@pytest.mark.parametrize(
    ("text", "release"),
    [("3.9.0", (3, 9, 0)), ("3.10.0rc1", (3, 10, 0)), ("2.15.0+cpu", (2, 15, 0)), ("1.26", (1, 26))],
)
def test_release_is_the_numeric_prefix(text: str, release: tuple[int, ...]) -> None:
    assert versions._release(text) == release


@pytest.mark.parametrize(
    ("package", "version"),
    [("mujoco", "3.8.0"), ("mujoco", "3.10.0"), ("mujoco", "4.0.0"), ("numpy", "2.1.0"), ("robosuite", "1.4.1")],
)
def test_a_version_outside_its_pin_names_what_to_install(monkeypatch, package: str, version: str) -> None:
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: version if name == package else real(name))
    with pytest.raises(VersionError, match=rf"{package} {version} is installed.*pip install '{package}"):
        versions.check_pins()


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
