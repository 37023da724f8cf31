"""Memory that training steps take and give back, over and over."""

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""glibc's M_TRIM_THRESHOLD and M_MMAP_THRESHOLD."""


def keep_freed_memory() -> bool:
    """Let the process keep the memory that it frees, so that it is not asked of the kernel, zeroed, at every step.

    glibc gives blocks of 128 KiB and more back at once; pages taken again cost a third of a small image encoder's
    training step. Holds for the rest of the process, which then keeps its peak. On other C libraries nothing happens.

    Returns:
        Whether the C library took it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    largest = 32 << 20  # the most that glibc accepts on 64-bit machines
    return bool(mallopt(_MMAP_THRESHOLD, largest)) and bool(mallopt(_TRIM_THRESHOLD, 2**31 - 1))
