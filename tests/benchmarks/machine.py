"""The machine that a figure comes from."""

import os
import platform
from pathlib import Path


def machine() -> str:
    """Processor and cores."""
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    name = names[0].partition(":")[2].strip() if names else platform.processor()
    return f"{name}, {os.cpu_count()} cores"


def machine_and_load() -> str:
    """Processor, cores and the present load."""
    return f"{machine()}, load {os.getloadavg()[0]:.1f}"
