"""Tells whoever wants to know that loops are being compiled: once after an installation.

Apart from `ematwin.numerics.compile`, so that a command can listen before numba is loaded.
"""

from collections.abc import Callable

listener: Callable[[], None] | None = None
"""Called in the first thread that has to compile, once."""


def compiling() -> None:
    """A loop is not on disk and will be compiled now."""
    global listener
    told, listener = listener, None
    if told is not None:
        told()
