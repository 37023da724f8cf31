"""Build the reference of the Python interface from docstrings: ``python docs/reference.py FOLDER``, or ``make docs``.

The front page is the package with its public names; every module beneath it has a page of its own. Nothing is loaded
from a network, neither while building nor while reading.
"""

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path

import pdoc
import pdoc.extract

PACKAGE = "ocplanner"
_LEFT_OUT = ("ocplanner.__main__", "ocplanner.integrations.robomimic")
"""What runs when it is imported, and what changes robomimic when it is: both are described in pages of docs/."""


def module_names(package: str = PACKAGE) -> Iterator[str]:
    """The package and all public modules beneath it, in order."""
    yield package
    for found in pkgutil.iter_modules(importlib.import_module(package).__path__, f"{package}."):
        if found.name in _LEFT_OUT or found.name.rpartition(".")[2].startswith("_"):
            continue
        if found.ispkg:
            yield from module_names(found.name)
        else:
            yield found.name


def build(folder: Path) -> Path:
    """Write the pages into ``folder`` and return the front page."""
    wanted: list[str] = []
    covered: set[str] = set()
    with ExitStack() as resolved:
        for name in module_names():
            resolved.enter_context(_lazy_names_resolved(name))
            if name not in covered:  # a package covers what its __all__ lets pdoc see
                wanted.append(name)
                covered |= set(pdoc.extract.walk_specs([name]))
        pdoc.render.configure(docformat="google", show_source=False, footer_text=f"{PACKAGE} {version(PACKAGE)}")
        pdoc.pdoc(*wanted, output_directory=folder)
    return folder / f"{PACKAGE}.html"


@contextmanager
def _lazy_names_resolved(name: str) -> Iterator[None]:
    """While it lasts, what a module imports on first use stands in it: pdoc sees only what is there."""
    module = importlib.import_module(name)
    lazy = [public for public in getattr(module, "__all__", ()) if public not in vars(module)]
    for public in lazy:
        setattr(module, public, getattr(module, public))
    try:
        yield
    finally:
        for public in lazy:
            delattr(module, public)


def main() -> None:
    """Build, and say where the front page is."""
    parser = argparse.ArgumentParser(description="Build the reference of the Python interface.")
    parser.add_argument("folder", type=Path, nargs="?", default=Path("dist/reference"))
    sys.stdout.write(f"{build(parser.parse_args().folder)}\n")


if __name__ == "__main__":
    main()
