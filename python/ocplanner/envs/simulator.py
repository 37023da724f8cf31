"""The only module that imports mujoco and robosuite: quietly, and with a clear error if OpenGL is missing."""

import contextlib
import ctypes
import importlib
import importlib.util
import logging
import os
from pathlib import Path
from typing import Any

from ocplanner.errors import RenderingError
from ocplanner.versions import check_pins

_BACKENDS = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa"}
_PACKAGES = {"egl": "libegl1 libgl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
_ON_SCREEN = "glfw"
_SET = "set it to egl (graphics card, or Mesa without one) or osmesa (Mesa), which draw without a screen"


def rendering_error(cause: object) -> RenderingError:
    """The error for a machine without headless OpenGL: it names the packages to install, or the wrong variable."""
    found = os.environ.get("MUJOCO_GL", "")
    backend = found.lower()
    if found and backend not in (*_PACKAGES, _ON_SCREEN):
        return RenderingError(
            f"the environment variable MUJOCO_GL is {found!r}, which is no OpenGL to draw with; {_SET}"
        )
    if backend not in _PACKAGES:
        remedy = _SET
    else:
        remedy = f"on Debian or Ubuntu run: sudo apt-get install {_PACKAGES[backend]}"
        if backend == "egl":
            remedy += f" (or install {_PACKAGES['osmesa']} and set MUJOCO_GL=osmesa)"
    return RenderingError(f"no working headless OpenGL with MUJOCO_GL={backend or 'unset'}: {cause}; {remedy}")


def gl_context(width: int, height: int) -> Any:
    """An OpenGL context of the backend that ``MUJOCO_GL`` names.

    ``mujoco.GLContext`` depends on the variable's value when mujoco was imported. If that was before ocplanner set the
    variable, it needs a screen.
    """
    backend = _BACKENDS.get(os.environ.get("MUJOCO_GL", "").lower())
    module = mujoco if backend is None else importlib.import_module(backend)
    return module.GLContext(width, height)


def _only_errors(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.ERROR


def _load_triton_library() -> None:
    """Load triton's library, if torch installed it, before OpenGL's.

    Mesa's software renderer and triton both contain LLVM. A process that draws first and trains later would crash when
    torch imports triton; in the other order both work.
    """
    spec = importlib.util.find_spec("triton")
    if spec is None or not spec.submodule_search_locations:
        return
    library = Path(next(iter(spec.submodule_search_locations)), "_C", "libtriton.so")
    with contextlib.suppress(OSError):  # missing, or not for this machine: then torch does not load it either
        ctypes.CDLL(str(library))


check_pins()
_load_triton_library()

# robosuite warns at import about an optional macro file. It sets the logger's level itself, but keeps filters.
logging.getLogger("robosuite_logs").addFilter(_only_errors)

try:
    mujoco: Any = importlib.import_module("mujoco")
    robosuite: Any = importlib.import_module("robosuite")
except (AttributeError, ImportError, OSError, RuntimeError) as error:
    # mujoco opens the OpenGL library when it is imported; a missing library raises any of these.
    if isinstance(error, ModuleNotFoundError):
        raise
    raise rendering_error(error) from error

__all__ = ["gl_context", "mujoco", "rendering_error", "robosuite"]
