"""Test commands that are compared: the usual motions of commissioning.

Reversals, constant speed both ways, steps, chirps, and small reversals before a stroke, of several
sizes and rates, without load and under loads that drive and brake. `ranked` puts them in order.
What makes a command good is the caller's: `design` asks for small errors, `discriminate` for
explanations that lie far apart.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.interrupt import until_interrupted
from ematwin.experiments.experiment import UNANSWERED, Experiment, RefusedError
from ematwin.models.base import Model
from ematwin.models.scenario import Chirp, Component, Profile, Scenario, Sine, Step
from ematwin.recordings.recording import Recording
from ematwin.showing.text import said

SECONDS = 60.0  # that a ranking without a budget takes at most
FINALISTS = 5  # commands that are compared once more

_SIZES = (0.95, 0.6, 0.3)  # shares of the travel; motion overshoots its command
_RISES = (1e-3, 0.05)  # shares of the duration that a step takes: a profile has no jumps

Progress = Callable[[int, float, int], object]
"""Takes the number of commands so far, the best value, and how many there are."""


@dataclass
class Ranking:
    """Commands within limits, the best first."""

    commands: list[Scenario] = field(default_factory=list)  # that are worth recording
    evaluations: int = 0  # how many were looked at
    stopped: str = "complete"  # why it ended: "complete", "budget", "time" or "interrupted"
    # demands of the command next to the limits, of those beyond them
    nearest: RefusedError | None = None

    def refusal(self, actuator: str, asked: Mapping[str, float]) -> InputError:
        """The error that says that no command keeps the limits."""
        told = ", ".join(f"{name} {value:g}" for name, value in asked.items())
        demands = {} if self.nearest is None else self.nearest.demands
        near = ", ".join(f"{name} {size:.3g}" for name, size in demands.items())
        return InputError(
            f"No command of {actuator} keeps the limits "
            f"({told or 'those of the given command'}) and moves enough to identify faults"
            + (f"; the nearest demands {near}" if near else "")
            + ". Raise the limits, leave some out, or begin from another scenario."
        )


def ranked(
    experiment: Experiment,
    given: Scenario,
    limits: Mapping[str, float],
    cost_of: Callable[[Scenario, Recording, float], float],
    *,
    budget: int | None,
    seed: int,
    progress: Progress | None,
) -> Ranking:
    """Rank the candidates in the duration of a given command, which is none of them.

    Parameters
    ----------
    experiment : whose healthy actuator has to keep the limits
    limits : of the demands, by name, SI
    cost_of : of a command, of the healthy recording of it by the fast model, and of a cost above
        which it does not matter; an error of `UNANSWERED` where there is none
    budget : commands that are looked at, or more until one can be used; None takes all, or as
        many as `SECONDS` allow
    seed : of the order in which they are looked at
    """
    commands = list(candidates(experiment.model, given, limits))
    order = np.random.default_rng(seed).permutation(len(commands)).tolist()
    found, ends = Ranking(), time.perf_counter() + (SECONDS if budget is None else math.inf)
    most = len(commands) if budget is None else min(budget, len(commands))
    seen: list[tuple[float, int]] = []
    with until_interrupted() as interrupts:
        for n in order:
            interrupts.check()
            if seen and (found.evaluations >= most or time.perf_counter() > ends):
                found.stopped = "budget" if found.evaluations >= most else "time"
                break
            found.evaluations += 1
            enough = seen[FINALISTS - 1][0] if len(seen) >= FINALISTS else math.inf
            try:
                healthy = experiment.move(commands[n], limits)
                cost = cost_of(commands[n], healthy, enough)
            except RefusedError as error:
                least = math.inf if found.nearest is None else found.nearest.excess
                found.nearest = error if 0.0 < error.excess < least else found.nearest
            except UNANSWERED:
                pass
            else:
                seen = sorted([*seen, *([(cost, n)] if math.isfinite(cost) else [])])
            if progress is not None:
                best = seen[0][0] if seen else math.inf
                progress(found.evaluations, best, max(most, found.evaluations))
    if interrupts.ended:
        found.stopped = "interrupted"
    found.commands = [commands[n] for _, n in seen]
    return found


def candidates(model: Model, given: Scenario, limits: Mapping[str, float]) -> Iterator[Scenario]:
    """Yield test commands in the duration of a given one.

    ``limits`` are largest demands by name, SI: that of the command bounds sizes, "load" the load.
    """
    duration, unit = given.duration, model.channel(model.command).unit
    size = next(
        (limits[one.name] for one in model.limited
         if model.command in one.channels and not one.is_rate and one.name in limits),
        float(np.abs(given.histories(np.linspace(0.0, duration, 1001))[0]).max()),
    )  # fmt: skip
    load = limits.get("load", 0.0)
    loads: dict[str, list[Component]] = {"": []}
    if load > 0.0 and model.disturbed:
        told = said(load, model.channel(model.disturbed).unit, 3)
        loads[f", load of {told} both ways"] = [
            Step(value=load, time=0.25 * duration),
            Step(value=-2.0 * load, time=0.5 * duration),
            Step(value=load, time=0.75 * duration),
        ]
    known = set()
    for share in _SIZES:
        for what, command in _motions(
            share * size, _SIZES[0] * limits.get("speed", math.inf), duration, unit
        ):
            if what in known:  # the speed bounds both
                continue
            known.add(what)
            for under, parts in loads.items():
                yield Scenario(
                    name=what.partition(",")[0], description=f"{what}{under}", duration=duration,
                    command=command, load=parts,
                )  # fmt: skip


def _motions(
    size: float, speed: float, duration: float, unit: str
) -> Iterator[tuple[str, list[Component]]]:
    """Yield motions of a size, or less where they would be faster, with a phrase on each."""
    for n in (1, 2, 4, 8):  # of reversals and constant speed, in the duration
        hertz = n / duration
        reach = _rounded(min(size, speed / (2.0 * math.pi * hertz)))
        told = f"{said(reach, unit, 2)} at {hertz:.3g} Hz"
        yield f"reversals, {told}", [Sine(amplitude=reach, frequency=hertz)]
        half = 0.5 * reach  # starts without a jump of the speed
        yield (
            f"reversals from rest, 0 to {told}",
            [Step(value=half), Sine(amplitude=half, frequency=hertz, phase=-0.5 * math.pi)],
        )
        reach = _rounded(min(size, speed / (4.0 * hertz)))
        rate = said(4.0 * reach * hertz, f"{unit}/s", 2)
        time = [0.0, *((k + 0.5) * 0.5 * duration / n for k in range(2 * n)), duration]
        value = [0.0, *(reach if k % 2 == 0 else -reach for k in range(2 * n)), 0.0]
        told = said(reach, unit, 2)
        yield (f"constant speed both ways, {told} at {rate}", [Profile(time=time, value=value)])
    for rise in _RISES:
        reach = _rounded(min(size, 0.5 * speed * rise * duration if rise > _RISES[0] else size))
        starts = [duration * share for share in (0.05, 0.3, 0.55, 0.8)]
        time = [0.0, *(t for start in starts for t in (start, start + rise * duration)), duration]
        value = [0.0, 0.0, reach, reach, -reach, -reach, reach, reach, 0.0, 0.0]
        within = said(rise * duration, "s", 2)
        yield (
            f"steps, {said(reach, unit, 2)} both ways within {within}",
            [Profile(time=time, value=value)],
        )
    for n in (4, 8, 16):  # periods in the duration, were the end of a chirp as fast throughout
        reach = _rounded(min(size, speed * duration / (2.0 * math.pi * n)))
        yield (
            f"chirp, {said(reach, unit, 2)} up to {n / duration:.3g} Hz",
            [Chirp(amplitude=reach, f_start=1.0 / duration, f_end=n / duration)],
        )
    for n, share in product((8, 16), (0.03, 0.1)):  # gap and static friction are small
        hertz = n / duration
        small = _rounded(min(share * size, speed / (2.0 * math.pi * hertz)))
        reach = _rounded(min(size - small, 0.1 * speed * duration))
        time = [0.0, 0.7 * duration, 0.8 * duration, duration]
        yield (
            f"reversals of {said(small, unit, 2)} at {hertz:.3g} Hz, then a stroke of "
            f"{said(reach, unit, 2)}",
            [Sine(amplitude=small, frequency=hertz),
             Profile(time=time, value=[0.0, 0.0, reach, reach])],
        )  # fmt: skip


def _rounded(size: float) -> float:
    """A size rounded down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(size)) - 1)
    return float(f"{math.floor(size / unit) * unit:.2g}")
