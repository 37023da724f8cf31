"""Keeps the memory that training steps allocate and free again and again, and says so where it does not suffice."""

import contextlib
import ctypes
from collections.abc import Iterator

from ocplanner.errors import TrainingError

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""glibc's M_TRIM_THRESHOLD and M_MMAP_THRESHOLD."""


def keep_freed_memory() -> bool:
    """Let the process keep freed memory, so that the kernel need not zero and map it again at each step.

    glibc returns blocks of 128 KiB and more at once; mapping them again takes a third of the training step of a small
    image encoder. The setting holds for the rest of the process, which then keeps its peak memory. Other C libraries
    ignore it.

    Returns:
        Whether the C library accepted the setting.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    largest = 32 << 20  # the largest value that glibc accepts on 64-bit machines
    return bool(mallopt(_MMAP_THRESHOLD, largest)) and bool(mallopt(_TRIM_THRESHOLD, 2**31 - 1))


@contextlib.contextmanager
def enough_memory(batch: int) -> Iterator[None]:
    """Say what to do if a training step finds too little memory.

    Raises:
        TrainingError: it does.
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        text = str(error)
        if not isinstance(error, MemoryError) and "allocate memory" not in text and "out of memory" not in text:
            raise
        raise TrainingError(
            f"not enough memory for a batch of {batch} ({text.splitlines()[0] if text else 'MemoryError'}); give a "
            "smaller batch, or free some memory; the run continues from its last checkpoint only with the same batch"
        ) from error
