"""Runs one of robomimic's scripts with the hint registered.

``python -m ocplanner.integrations.robomimic SCRIPT ...``: SCRIPT is a name in ``robomimic/scripts`` (``train``,
``run_trained_agent``), the rest its own arguments.
"""

import importlib.util
import runpy
import sys

import ocplanner.integrations.robomimic  # noqa: F401  registers the hint


def main() -> None:
    """Run the script named first on the command line."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if not name.isidentifier() or importlib.util.find_spec(f"robomimic.scripts.{name}") is None:
        sys.exit(f"error: unknown robomimic script {name!r}; give one, for example: train --config FILE.json")
    del sys.argv[1]
    runpy.run_module(f"robomimic.scripts.{name}", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
