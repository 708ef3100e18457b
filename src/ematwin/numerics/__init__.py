"""Compilation, lanes, friction, backlash, filters: the material of models; no actuator.

Here is only what a command can listen to before numba is loaded: that loops are being compiled,
which happens once after an installation.
"""

from collections.abc import Callable

compile_listener: Callable[[], None] | None = None
"""Called in the first thread that has to compile, once."""


def compiling() -> None:
    """A loop is not on disk and will be compiled now."""
    global compile_listener
    told, compile_listener = compile_listener, None
    if told is not None:
        told()
