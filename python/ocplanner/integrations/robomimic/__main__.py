"""Runs one of robomimic's scripts with the hint registered, or exports a checkpoint.

``python -m ocplanner.integrations.robomimic SCRIPT ...``: SCRIPT is a name in ``robomimic/scripts`` (``train``,
``run_trained_agent``) and the rest its own arguments; or ``export --checkpoint FILE.pth --out policy.safetensors``.
"""

import importlib.util
import runpy
import sys

import tyro

from ocplanner.errors import OcplannerError
from ocplanner.integrations.robomimic import export_policy


def main() -> None:
    """Run what is named first on the command line; our errors leave one line and exit with 2."""
    try:
        _run(sys.argv[1] if len(sys.argv) > 1 else "")
    except OcplannerError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)


def _run(name: str) -> None:
    if name == "export":
        _export(sys.argv[2:])
        return
    if not name.isidentifier() or importlib.util.find_spec(f"robomimic.scripts.{name}") is None:
        sys.exit(f"error: unknown robomimic script {name!r}; give one, for example: train --config FILE.json")
    del sys.argv[1]
    runpy.run_module(f"robomimic.scripts.{name}", run_name="__main__", alter_sys=True)


def _export(arguments: list[str]) -> None:
    written = tyro.cli(export_policy, prog="python -m ocplanner.integrations.robomimic export", args=arguments)
    sys.stdout.write(f"{written}\n")


if __name__ == "__main__":
    main()
