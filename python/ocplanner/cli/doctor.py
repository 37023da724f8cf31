"""``ocplanner doctor``."""

import importlib
import os
import platform
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from ocplanner import versions
from ocplanner.errors import OcplannerError

_NEEDED_FREE_GB = 5.0


@dataclass(frozen=True)
class Finding:
    """The outcome of one check.

    Attributes:
        subject: what was checked.
        detail: what was found.
        remedy: what to do about it; None if all is well.
        fatal: whether ocplanner cannot work until then.
    """

    subject: str
    detail: str
    remedy: str | None = None
    fatal: bool = False


def check_dependencies() -> Finding:
    """The pinned packages."""
    try:
        versions.check_pins()
    except OcplannerError as error:
        return Finding("dependencies", str(error), "install the named version", fatal=True)
    found = versions.installed()
    return Finding("dependencies", ", ".join(f"{name} {found[name]}" for name in versions.PINNED))


def check_core() -> Finding:
    """The compiled Rust part."""
    try:
        importlib.import_module("ocplanner._core")
    except ImportError as error:
        return Finding("Rust core", f"not importable: {error}", "run `make setup` or `pip install .` again", fatal=True)
    return Finding("Rust core", "present")


def check_rendering() -> Finding:
    """Draws a picture of the Square task and checks that it is not blank."""
    backend = f"MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}"
    try:
        from ocplanner.envs import make_env

        with make_env("Square") as env:
            env.observe()
            begin = time.perf_counter()
            picture = env.observe()["agentview"]
            elapsed = time.perf_counter() - begin
    except OcplannerError as error:
        text, _, remedy = str(error).rpartition("; ")
        return Finding("rendering", text or str(error), remedy or "see the message", fatal=True)
    if picture.std() < 1.0:
        remedy = "try MUJOCO_GL=osmesa (apt-get install libosmesa6) or update Mesa (libgl1-mesa-dri)"
        return Finding("rendering", f"{backend} draws blank pictures", remedy, fatal=True)
    return Finding("rendering", f"{backend}, an 84x84 picture in {1e3 * elapsed:.1f} ms")


def check_processor(cpuinfo: Path = Path("/proc/cpuinfo")) -> Finding:
    """Vector instructions and cores."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    try:
        text = cpuinfo.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return Finding("processor", f"{platform.machine()}, {cores} cores; vector instructions unknown")
    flags = set(next((line for line in text.splitlines() if line.startswith("flags")), "").split())
    found = [name for name in ("avx2", "fma", "avx512f") if name in flags]
    detail = f"{platform.machine()}, {cores} cores, {' '.join(found) or 'neither AVX2 nor AVX-512'}"
    if {"avx2", "fma"} <= flags:
        return Finding("processor", detail)
    return Finding(
        "processor", detail, "planning works, but several times slower; prefer a processor with AVX2 and FMA"
    )


def check_disk(folder: Path | None = None) -> Finding:
    """Free space for data sets and runs."""
    folder = folder or Path.cwd()
    free = shutil.disk_usage(folder).free / 1e9
    detail = f"{free:.1f} GB free at {folder}"
    if free < _NEEDED_FREE_GB:
        return Finding("disk", detail, f"free some space: a rendered data set and a run need {_NEEDED_FREE_GB:.0f} GB")
    return Finding("disk", detail)


def check_cache() -> Finding:
    """Whether simplified meshes can be cached."""
    from ocplanner.envs.meshes import cache_folder

    folder = cache_folder()
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not os.access(existing, os.W_OK):
        remedy = "set XDG_CACHE_HOME to a writable folder; until then environments start slowly"
        return Finding("cache", f"{folder} is not writable", remedy)
    return Finding("cache", str(folder))


CHECKS: tuple[Callable[[], Finding], ...] = (
    check_dependencies,
    check_core,
    check_rendering,
    check_processor,
    check_disk,
    check_cache,
)


@dataclass(frozen=True)
class Doctor:
    """Check this machine and say what to do about each fault."""

    def run(self) -> None:
        """Print one line for each check, and the remedy under each fault.

        Raises:
            OcplannerError: ocplanner cannot work on this machine.
        """
        console = Console(highlight=False, soft_wrap=True)
        fatal = []
        for check in CHECKS:
            finding = check()
            mark = (
                "[green]ok  [/]" if finding.remedy is None else "[red]FAIL[/]" if finding.fatal else "[yellow]note[/]"
            )
            console.print(f"{mark} {finding.subject}: ", end="")
            console.print(finding.detail, markup=False)
            if finding.remedy is not None:
                console.print(f"     -> {finding.remedy}", markup=False)
            if finding.fatal:
                fatal.append(finding.subject)
        if fatal:
            raise OcplannerError(f"ocplanner cannot work here yet: {', '.join(fatal)}")


COMMAND = Doctor
