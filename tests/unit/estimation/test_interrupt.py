"""Ctrl-C is answered, even where it was swallowed on the way."""

import contextlib
import signal
import time
import traceback

import numpy as np
import pytest

from ematwin import identify, simulate
from ematwin.estimation import identify as identifying
from ematwin.estimation.interrupt import noting_interrupts


def test_an_interrupt_that_was_swallowed_is_raised_at_the_next_check() -> None:
    with noting_interrupts() as interrupts:
        interrupts.check()
        # as a destructor or the callback of a compiler would
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupts.check()
        interrupts.check()


def test_an_interrupt_while_numba_makes_python_objects_comes_a_moment_later() -> None:
    held = {"__name__": "numba.core.serialize", "press": lambda: signal.raise_signal(signal.SIGINT)}
    with noting_interrupts() as interrupts:
        exec("press()", held)
        with pytest.raises(KeyboardInterrupt):
            time.sleep(5.0)
    assert interrupts.pressed


def test_the_best_so_far_comes_within_two_seconds_on_a_long_record() -> None:
    # ten seconds at 20 kHz, of an actuator that the twin does not fit: the longest search there is
    record = simulate("monitor", "ramp", {"friction": 0.2}, sample_rate=20_000.0)
    current = record.current + 5.0 * np.sin(40.0 * record.time)
    hard = record.changed(current=current)
    identify(hard, budget=64)  # compiled, or loaded
    pressed = 0.0

    def press(*_: object) -> None:
        nonlocal pressed
        pressed = time.monotonic()
        signal.raise_signal(signal.SIGINT)

    def begun(*_: object) -> None:  # there is something to keep, however busy the machine is
        if not pressed and signal.getitimer(signal.ITIMER_REAL)[0] == 0.0:
            signal.setitimer(signal.ITIMER_REAL, 0.3)  # of 1.1 s

    before = signal.signal(signal.SIGALRM, press)
    try:
        found = identify(hard, budget=1_000_000, progress=begun)
        waited = time.monotonic() - pressed
    except KeyboardInterrupt:  # would end all tests of this worker
        pytest.fail(f"an interrupt got through:\n{traceback.format_exc()}")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert found.stopped == "interrupted"
    assert np.isfinite(found.cost)
    assert waited < 2.0


@pytest.mark.parametrize("part", ["assess", "rivals_of"])
def test_an_interrupt_after_the_search_keeps_what_it_found(monkeypatch, part: str) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    record = simulate("monitor", faults={"short_b": 0.2})
    monkeypatch.setattr(identifying, part, pressed)
    found = identify(record, exact=True)
    assert found.stopped == "interrupted"
    assert found.verdict.grade == "none"
    assert "nterrupted" in found.verdict.reason
    assert found.values["short_b"] == pytest.approx(0.2, abs=0.02)
