"""Memory that was freed and is kept by the C library goes back to the system when asked."""

import ctypes
import os

import pytest

from benchmarks.vitals import vitals
from ros2_kafka_bridge.outside.malloc import find_trim

CHUNK = 64 << 10  # small: glibc takes large ones from the system, one by one
COUNT = 500


def anon_kib() -> int:
    return vitals(os.getpid()).anon_kib


def test_what_was_freed_goes_back_to_the_system() -> None:
    libc = ctypes.CDLL(None)
    libc.malloc.restype = ctypes.c_void_p
    chunks = [ctypes.c_void_p(libc.malloc(ctypes.c_size_t(CHUNK))) for _ in range(COUNT)]
    for chunk in chunks:
        ctypes.memset(chunk, 1, CHUNK)
    for chunk in chunks[:-1]:  # behind the last one nothing can go back by itself
        libc.free(chunk)
    kept_kib = anon_kib()
    find_trim()()
    libc.free(chunks[-1])
    assert kept_kib - anon_kib() > CHUNK * COUNT / 1024 * 0.9


def test_a_c_library_that_has_no_such_call_is_let_be(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes, 'CDLL', lambda _name: object())
    find_trim()()
