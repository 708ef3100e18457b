"""`Traces` against the same steps in a plain loop, one candidate after the other."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from ematwin.numerics.compile import step
from ematwin.numerics.lanes import Traces


class Constants(NamedTuple):
    """Of a leaky integrator that may run away."""

    rate: float
    gain: float


class State(NamedTuple):
    """What it remembers."""

    level: float
    held: float


class Answer(NamedTuple):
    """What is seen of it."""

    level: float
    mean: float


@step
def sampled(now, command, load, sample, c, interval):
    """Hold the command of every second sample."""
    held = command if sample % 2 == 0 else now.held
    return State(now.level, held), Answer(now.level, 0.5 * (now.level + held))


@step
def advanced(now, command, load, c, dt):
    """Explicit Euler, under what is held, the command and a load."""
    level = now.level + dt * (c.gain * (now.held + command - load) + c.rate * now.level)
    return State(level, now.held)


TRACES = Traces(Constants, State, Answer, sampled, advanced)
COMMAND = np.sin(np.linspace(0.0, 6.0, 40))
LOAD = np.linspace(0.0, 0.3, 40)
RATES = np.linspace(-3.0, -1.0, 37)  # three blocks of lanes, the last one in part


def plain(rate, start):
    """The answers (2, S) of one candidate."""
    c, now, rows = Constants(rate, 2.0), State(start, 0.0), []
    for n in range(COMMAND.size):
        now, seen = sampled.py_func(now, COMMAND[n], LOAD[n], n, c, 0.1)
        rows.append(seen)
        for j in range(3):
            if n + 1 < COMMAND.size:
                share = j / 3
                command = COMMAND[n] + share * (COMMAND[n + 1] - COMMAND[n])
                load = LOAD[n] + share * (LOAD[n + 1] - LOAD[n])
                now = advanced.py_func(now, command, load, c, 0.1 / 3)
    return np.array(rows).T


def traces(rates, threads=None):
    """The answers (B, 2, S) of candidates that start at different levels."""
    start = State(np.linspace(0.0, 1.0, rates.size), 0.0)
    found = TRACES(
        COMMAND, LOAD, Constants(rates, 2.0), start, 0.1, 3, count=rates.size, threads=threads
    )
    return np.stack([found["level"], found["mean"]], axis=1)


def test_each_candidate_is_that_of_a_plain_loop():
    found = traces(RATES)
    for n, start in enumerate(np.linspace(0.0, 1.0, RATES.size)):
        np.testing.assert_allclose(found[n], plain(RATES[n], start), rtol=1e-12, atol=1e-12)


def test_the_number_of_threads_does_not_change_a_digit():
    np.testing.assert_array_equal(traces(RATES, 1), traces(RATES, 3))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_constant_that_is_no_number_gives_nan_and_spoils_no_other(bad):
    rates = RATES.copy()
    rates[20] = bad
    found, healthy = traces(rates), traces(RATES)
    assert np.isnan(found[20]).all()
    others = np.arange(RATES.size) != 20
    np.testing.assert_array_equal(found[others], healthy[others])


def test_a_candidate_that_runs_away_is_nan_from_there_on():
    rates = RATES.copy()
    rates[3] = 1e12
    found = traces(rates)[3]
    first = int(np.argmax(~np.isfinite(found[0])))
    assert 0 < first < COMMAND.size
    assert np.isfinite(found[:, :first]).all()
    assert np.isnan(found[:, first:]).all()
