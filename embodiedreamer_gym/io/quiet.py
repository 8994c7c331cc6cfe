"""Suppress the output of C libraries."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Redirect file descriptors 1 and 2 to the null device in the block; Python's own streams are flushed first."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = {stream: os.dup(stream) for stream in (1, 2)}
    with open(os.devnull, "wb") as nothing:
        for stream in saved:
            os.dup2(nothing.fileno(), stream)
    try:
        yield
    finally:
        _flush_c()
        for stream, copy in saved.items():
            os.dup2(copy, stream)
            os.close(copy)


def _flush_c() -> None:
    """Flush the C library's buffers, which would otherwise be printed later."""
    import ctypes

    with contextlib.suppress(OSError, AttributeError, TypeError):  # no C library can be loaded by name on this system
        ctypes.CDLL(None).fflush(None)
