"""What the C library keeps of memory that was freed."""

import ctypes
from collections.abc import Callable


def find_trim() -> Callable[[], object]:
    """Find what gives all of it back to the system; glibc does little of that by itself.

    It takes 0.2 to 2 ms, and threads that allocate wait for a part of that. A C library that
    has none, as musl, keeps little.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except AttributeError:
        return lambda: None
    trim.argtypes = (ctypes.c_size_t,)
    return lambda: trim(0)
