import platform
import subprocess
import sys

import pytest

from ocplanner.errors import TrainingError
from ocplanner.training.memory import enough_memory

FAULTS = """
import resource
import numpy as np
from ocplanner.training.memory import keep_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(50):
        [np.ones(1 << 17) for _ in range(16)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
without = faults()
assert keep_freed_memory()
faults()
print(without, faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc takes the setting")
def test_memory_is_not_asked_of_the_kernel_again():
    outcome = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True)
    without, kept = map(int, outcome.stdout.split())
    assert kept < 100 < without / 10


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("[enforce fail] can't allocate memory: you tried ..."),
        RuntimeError("CUDA out of memory."),
    ],
)
def test_too_little_memory_for_a_batch_is_told(error):
    with (
        pytest.raises(TrainingError, match=r"not enough memory for a batch of 512 .*give a smaller batch"),
        enough_memory(512),
    ):
        raise error


def test_other_errors_of_a_step_stay():
    with pytest.raises(RuntimeError, match="shapes differ"), enough_memory(512):
        raise RuntimeError("shapes differ")
