"""Keeps the memory that training steps allocate and free again and again."""

import ctypes

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
