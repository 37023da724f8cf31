"""Connects to a Ray cluster, or starts one."""

import importlib
import os
import subprocess
import sys
from typing import Any

from ocplanner.errors import ClusterError, VersionError

_OBJECT_STORE_BYTES = 256 * 2**20
_PATIENCE_S = 45
_PROBE = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False, logging_level='ERROR')"


def connect(address: str, workers: int) -> tuple[Any, bool]:
    """Connect to the cluster at an address, or use the connection that this process already has.

    Args:
        address: ``"HOST:PORT"``, ``"ray://HOST:PORT"``, ``"auto"``, or ``"local"`` to start one on this machine.
        workers: number of workers that a local cluster has room for.

    Returns:
        The module ``ray``, and whether this call connected, so that the caller must end with ``ray.shutdown()``.

    Raises:
        VersionError: Ray is not installed.
        ClusterError: no cluster answers at the address, or none can be started.
    """
    try:
        ray: Any = importlib.import_module("ray")
    except ModuleNotFoundError as error:
        raise VersionError("ray is not installed; run: pip install 'ocplanner[ray]'") from error
    if ray.is_initialized():
        return ray, False
    try:
        if address == "local":
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # otherwise Ray reports to its makers
            ray.init(
                address="local",
                num_cpus=workers,
                include_dashboard=False,
                object_store_memory=_OBJECT_STORE_BYTES,
                logging_level="ERROR",
            )
        else:
            _probe(address)
            ray.init(address=address, logging_level="ERROR")
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _unreachable(address, str(error)) from error
    return ray, True


def _probe(address: str) -> None:
    """Connect from a process that can be killed: if nothing answers, Ray tries forever."""
    try:
        subprocess.run([sys.executable, "-c", _PROBE, address], capture_output=True, check=True, timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired as error:
        raise _unreachable(address, f"no answer within {_PATIENCE_S} s") from error
    except subprocess.CalledProcessError as error:
        log = error.stderr.decode(errors="replace").strip()
        if "InvalidAuthToken" in log:
            raise _unreachable(address, "it requires a token: set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN") from error
        raise _unreachable(address, log.splitlines()[-1] if log else "no reason given") from error


def _unreachable(address: str, reason: str) -> ClusterError:
    return ClusterError(
        f"no Ray cluster can be reached at {address!r} ({reason}); start one with 'ray start --head', "
        "or use 'local' for one on this machine only"
    )
