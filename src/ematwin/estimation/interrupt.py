"""Ctrl-C during a search: answered at the next batch, even if it was swallowed on the way.

Python raises KeyboardInterrupt wherever the main thread happens to be. Where that is a callback of
a compiler or a destructor, the exception is printed and lost, and a search would go on to its end.
Here the signal is also noted, and `InterruptNoted.check` raises the lost exception again.

Where numba makes Python objects of what a loop returned, an exception would end in a SystemError:
there the signal comes again a moment later.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_BOXING = ("numba.core.serialize", "namedtuple_")  # modules that run between a loop and its caller


class InterruptNoted:
    """Whether Ctrl-C was pressed since the search began."""

    def __init__(self) -> None:
        self.pressed = False
        self.ended = False  # whether it ended a block (`until_interrupted`)

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed and nothing has come of it."""
        if self.pressed:
            self.pressed = False
            raise KeyboardInterrupt


def _is_boxing(frame: FrameType | None) -> bool:
    """Whether numba called what was interrupted, were it the start of the timer below."""
    while frame and not frame.f_globals.get("__name__", "").startswith(_BOXING):
        frame = frame.f_back
    return frame is not None


@contextmanager
def noting_interrupts() -> Iterator[InterruptNoted]:
    """Note SIGINT while the block runs; the handler from before still raises as it would.

    Outside the main thread, which alone receives signals, nothing is changed.
    """
    noted, main = InterruptNoted(), threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    if not (main and callable(before)):  # ignored, or not ours to know
        yield noted
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if _is_boxing(frame):
            threading.Timer(0.01, signal.raise_signal, [number]).start()
            return
        noted.pressed = True
        before(number, frame)

    signal.signal(signal.SIGINT, handle)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def until_interrupted() -> Iterator[InterruptNoted]:
    """As `noting_interrupts`, for a block that Ctrl-C ends and whose results so far count."""
    with noting_interrupts() as noted:
        try:
            yield noted
        except KeyboardInterrupt:
            noted.ended = True
