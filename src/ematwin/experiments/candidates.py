"""Healthy tests that are compared: the motions by which drives are commissioned.

Reversals, constant speed both ways, steps and chirps, of several sizes and rates, without load and
under loads that drive and brake.
"""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from ematwin.models.base import Model
from ematwin.models.history import Chirp, Component, Profile, Sine, Step
from ematwin.models.scenario import Scenario
from ematwin.showing.text import said

_SIZES = (0.95, 0.6, 0.3)  # shares of the travel; motion overshoots its command
_RISES = (1e-3, 0.05)  # shares of the duration that a step takes: a profile has no jumps


def candidates(model: Model, given: Scenario, limits: Mapping[str, float]) -> Iterator[Scenario]:
    """Yield healthy tests in the duration of a given command.

    Parameters
    ----------
    model : of the kind
    given : Scenario
    limits : largest demands by name, SI; the command's limit bounds sizes, "load" the load
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


def _rounded(size: float) -> float:
    """A size rounded down to two digits."""
    unit = 10.0 ** (math.floor(math.log10(size)) - 1)
    return float(f"{math.floor(size / unit) * unit:.2g}")
