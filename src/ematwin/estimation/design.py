"""The command that tells a fault best, within what a test may demand: `design`.

An optimal design of an experiment (Atkinson, Donev and Tobias 2007, Optimum Experimental Designs,
with SAS, chapters 10 and 17): the numbers of a scenario are chosen so that the expected standard
error (`ematwin.estimation.expected`)

    of one named fault, everything else being a nuisance (Ds-optimal), or
    of the fault that is worst in share of its range (min-max),

is least. Differential evolution searches the box of `DesignSpace`, from the scenario itself. The
best few are judged again at other faults, and `identify` answers simulated recordings of the best
of these and of the given command, all of the same actuators. A few recordings are luck as well: the
given one stays unless the other promises clearly less and errs clearly less.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.baseline import Baseline, baseline_of
from ematwin.estimation.command_search import (
    BEYOND,
    BUDGET,
    CommandSearch,
    Looked,
    Progress,
    begun,
    demands_of,
    excess,
    limits_of,
)
from ematwin.estimation.expected import (
    DRAWS,
    FRESH,
    Judge,
    Judged,
    drawn_faults,
    fault_shares,
    observe,
)
from ematwin.estimation.identifiability import Identifiability, identifiability
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.models.base import Demand, Model, no_unknown
from ematwin.models.designed import DesignSpace
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise
from ematwin.showing.drawing import drawn

TRIALS = 8  # recordings of each command: its root mean square error is known to a fifth
CLEARLY = 1.1  # times less that another command has to promise, and to err
_FINALISTS = 5  # commands that are judged thoroughly
_OTHERS = 7919  # seeds of trials lie so far from those of a search and of `Design.check`


@dataclass(frozen=True)
class Promise:
    """What a command promises.

    Attributes
    ----------
    scenario : Scenario
    errors : expected standard error of each magnitude, by name
    shares : the same over the range of the fault
    demands : what it asks of a healthy actuator, by name, SI
    faulty : the most that it asked of one with faults
    told : Identifiability, at faults that are only just ones
    observed : root mean square of the errors that `identify` made on ``checks`` simulated
        recordings, by name; empty if none were made
    checks : how many
    """

    scenario: Scenario
    errors: dict[str, float]
    shares: dict[str, float]
    demands: dict[str, float]
    faulty: dict[str, float]
    told: Identifiability
    observed: dict[str, float] = field(default_factory=dict)
    checks: int = 0

    @property
    def weakest(self) -> str:
        """The fault whose expected error is the largest share of its range."""
        return max(self.shares, key=lambda name: self.shares[name])

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; what is infinite is null."""
        return {
            "scenario": self.scenario.model_dump(mode="json", exclude_none=True),
            "errors": {n: x if math.isfinite(x) else None for n, x in self.errors.items()},
            "weakest": self.weakest,
            "demands": self.demands,
            "demands_with_faults": self.faulty,
            "identifiability": self.told.as_dict(),
            "observed": self.observed or None,
            "checks": self.checks,
        }


@dataclass(frozen=True)
class Design:
    """The command that was found, beside the one from which it was made.

    Attributes
    ----------
    promised, default : of the command that was found, and of the given one in the same duration
    actuator : ParameterSet
    fault : the fault it was made for; None for the weakest
    limits : that it keeps, by name, SI
    demands : their units, in order
    held : what counts as known while commands are compared, because none of them tells it
    evaluations, seconds, stopped, seed : of the search
    judge : what judged the commands, with the actuator, what is known of it, and the noise
    checked : whether the errors observed are those of `check`; else they are of the recordings by
        which the command was chosen
    """

    promised: Promise
    default: Promise
    actuator: ParameterSet
    fault: str | None
    limits: dict[str, float]
    demands: tuple[Demand, ...]
    held: tuple[str, ...]
    evaluations: int
    seconds: float
    stopped: str
    seed: int
    judge: Judge = field(repr=False)
    checked: bool = False

    @property
    def scenario(self) -> Scenario:
        """The command."""
        return self.promised.scenario

    @property
    def gain(self) -> float:
        """The error of the default over that of the design, of the fault that it was made for."""
        return _worst(self.default.shares, self.fault) / _worst(self.promised.shares, self.fault)

    @property
    def observed_gain(self) -> float | None:
        """The same with the errors that were observed; None where none were."""
        if not self.promised.observed or not self.default.observed:
            return None
        widths = {one.name: one.width for one in self.judge.magnitudes}
        before, after = (
            {name: error / widths[name] for name, error in one.observed.items()}
            for one in (self.default, self.promised)
        )
        return _worst(before, self.fault) / _worst(after, self.fault)

    @property
    def sentence(self) -> str:
        """What was gained, in words."""
        what = f"the standard error of {self.fault}"
        if self.fault is None:
            what = "the largest standard error (share of the range)"
        if not math.isfinite(self.gain):
            return (
                f"The given command tells no faults; this one does, {self.promised.weakest} least."
            )
        if self.scenario == self.default.scenario:
            return (
                f"No command within the limits was found that lowers {what}; the given one stays."
            )
        if self.observed_gain is None:
            return (
                f"It is expected to lower {what} {self.gain:.1f} times; no recording was "
                "identified to see whether it does."
            )
        which = "other simulated recordings" if self.checked else "simulated recordings"
        return (
            f"It lowers {what} about {min(self.gain, self.observed_gain):.1f} times: "
            f"{self.gain:.1f} expected, {self.observed_gain:.1f} on {self.promised.checks} {which}."
        )

    def plot(self, kind: str = "errors") -> Any:
        """A figure of plotly: "errors" (of both commands, by fault) or "command"."""
        return drawn(self, kind, {"errors": "plot_errors", "command": "plot_command"})

    def check(
        self,
        recordings: int = 10,
        *,
        seed: int = 2,
        step: float | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> "Design":
        """The design, with the errors of `identify` on simulated recordings of both commands.

        Parameters
        ----------
        recordings : of each command, every one of another actuator
        seed : of faults, parameters and noise; other than that of the design
        step : float, s, of the model that is recorded; None takes the actuator's
        progress : called with the share done

        Returns
        -------
        Design, also after Ctrl-C: with the recordings that were done; itself if there are none
        """
        if recordings < 1:
            raise InputError(f"recordings must be at least 1, received {recordings}.")
        scenarios = [self.scenario, self.default.scenario]
        errors = observe(self.judge, scenarios, recordings, seed=seed, step=step, progress=progress)
        if not len(errors):
            return self
        promised, default = (
            replace(one, observed=_observed(self.judge, errors[:, n]), checks=len(errors))
            for n, one in enumerate((self.promised, self.default))
        )
        return replace(self, promised=promised, default=default, checked=True)

    def save(self, path: str | Path) -> None:
        """Write the command as a scenario file (TOML), whole or not at all."""
        self.scenario.save(path)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "actuator": self.actuator.name,
            "fault": self.fault,
            "sentence": self.sentence,
            "gain": self.gain if math.isfinite(self.gain) else None,
            "observed_gain": self.observed_gain,
            "limits": self.limits,
            "held": list(self.held),
            "promised": self.promised.as_dict(),
            "default": self.default.as_dict(),
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "stopped": self.stopped,
            "seed": self.seed,
        }


def design(
    actuator: ParameterSet | str | Path | Any | None = None,
    *,
    fault: str | None = None,
    scenario: Scenario | str | Path | None = None,
    duration: float | None = None,
    faults: Mapping[str, float] | None = None,
    noise: Noise | None = None,
    exact: bool = False,
    sample_rate: float | None = None,
    draws: int = DRAWS,
    fresh: int = FRESH,
    trials: int = TRIALS,
    budget: int = BUDGET,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
    trying: Callable[[float], object] | None = None,
    **limits: float,
) -> Design:
    """The command that tells the weakest fault best, or a named one, within limits.

    Parameters
    ----------
    actuator : a parameter set of any kind, its name or file; calibrated or not
    fault : the fault to tell; None takes that of which least is told, as a share of its range
    scenario : the command to begin from, of which the numbers are chosen; a `Scenario`, the name of
        a shipped one, or a file. None takes the kind's default
    duration : float, s; None takes that of the scenario
    faults : values at which to look of some faults; the others are drawn
    noise : of the sensors; None for that which the kind simulates by itself
    exact : parameters, load and sensors are known exactly
    sample_rate : float, Hz; None takes the kind's
    draws : fault vectors over which errors are averaged in the search
    fresh : others, on which the best commands and the given one are judged anew
    trials : simulated recordings of the most promising command, and of the given one, that are
        identified before one is chosen: the given one stays unless the other errs clearly less.
        0 takes the promise as it is
    budget : commands that are looked at
    seed : of the fault vectors, the noise and the search
    threads : that share a batch; None takes one for each core
    progress : called after each batch of commands
    trying : called with the share of the trials that is done
    limits : the largest travel, speed, current, load, in SI; what is not named is limited by what
        the scenario demands. Names are those of `Model.demands`

    Returns
    -------
    Design, also after Ctrl-C: the best found so far, ``stopped == "interrupted"``

    Raises
    ------
    InputError
        If an argument cannot be used, or no command keeps the limits.
    """
    started = time.perf_counter()
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    given = begun(model, scenario, duration)
    model.check_scenario(given, chosen)
    magnitudes = tuple(one for one in model.faults(chosen) if one.direction_of is None)
    wanted = _places(model, chosen, magnitudes, fault)
    for name, count, least in (("draws", draws, 1), ("fresh", fresh, 1), ("trials", trials, 0)):
        if count < least:
            raise InputError(f"{name} must be at least {least}, received {count}.")
    known = model.values_of(chosen, faults or {})
    held = {name: known[name] for name in faults or {}}
    vectors = drawn_faults(model, chosen, fault_shares(model, chosen, draws, seed), held)
    baseline = Baseline.of_simulation() if exact else baseline_of(actuator, chosen)
    judge = Judge(
        model, chosen, baseline, vectors, noise=noise, sample_rate=sample_rate, seed=seed,
        threads=threads,
    )  # fmt: skip
    within = limits_of(model, judge.judge(given, fast=True).demands, limits)

    def look(command: Scenario, limit: float) -> Looked:
        one = judge.judge(
            command, within, fast=True, enough=lambda errors: _worst_of(errors, wanted) > limit
        )
        return Looked(_worst_of(one.errors, wanted), one.demands, one.obstacle)

    search = CommandSearch(DesignSpace(model, given, within), within, look)
    search.run(budget, seed, progress)
    final = judge.at(
        drawn_faults(model, chosen, fault_shares(model, chosen, fresh, seed + 1), held)
    )
    best, default = _finalists(search, final, given, limits, wanted)
    both = [default] if best is default else [best, default]
    asked = trials if len(both) > 1 and search.stopped != "interrupted" else 0
    errors = observe(
        final, [one.scenario for one in both], asked, seed=_OTHERS + seed, progress=trying
    )
    if len(errors) < asked:
        search.stopped = "interrupted"

    def promise(one: Judged, n: int) -> Promise:
        told = identifiability(
            one.scenario, actuator, faults=held, noise=noise, exact=exact, sample_rate=sample_rate,
            seed=seed, threads=threads,
        )  # fmt: skip
        expected = _by_name(judge, one.errors)
        return Promise(
            scenario=one.scenario,
            errors=expected,
            shares={o.name: expected[o.name] / o.width for o in judge.magnitudes},
            demands=one.demands,
            faulty=one.faulty,
            told=told,
            observed=_observed(judge, errors[:, n]) if len(errors) else {},
            checks=len(errors),
        )

    kept = list(enumerate(both))
    if len(errors) and not default.obstacle:
        first, second = (_worst_of(rms, wanted) for rms in np.sqrt((errors**2).mean(axis=0)))
        if CLEARLY * first > second:
            kept = kept[1:]
    promised = [promise(one, n) for n, one in kept]
    return Design(
        promised=promised[0],
        default=promised[-1],
        actuator=chosen,
        fault=fault,
        limits=limits_of(model, default.demands, limits),
        demands=demands_of(model),
        held=judge.held,
        evaluations=search.evaluations,
        seconds=time.perf_counter() - started,
        stopped=search.stopped,
        seed=seed,
        judge=final,
    )


def _places(
    model: Model, actuator: ParameterSet, magnitudes: tuple[Unknown, ...], fault: str | None
) -> np.ndarray:
    """One over the range of each magnitude that counts, (n,); 0 where another was named."""
    names = [one.name for one in magnitudes]
    if fault is not None and fault not in names:
        directions = [o for o in model.faults(actuator) if o.name == fault]
        if directions:
            raise InputError(
                f"{fault} is the direction of {directions[0].direction_of}; name that instead."
            )
        raise no_unknown(fault, actuator, model)
    return np.array([1.0 / one.width if fault in (None, one.name) else 0.0 for one in magnitudes])


def _finalists(
    search: CommandSearch,
    judge: Judge,
    given: Scenario,
    limits: Mapping[str, float],
    wanted: np.ndarray,
) -> tuple[Judged, Judged]:
    """The best of the search and the given command, judged at fresh faults.

    The search has fitted its best commands to the few faults that it looked at: the given one is
    the best unless another promises clearly less.
    """
    default = judge.judge(given)
    final = limits_of(judge.model, default.demands, limits)
    usable = not default.obstacle and excess(default.demands, final) == 0.0
    if not usable and not default.obstacle:
        default = replace(default, obstacle=BEYOND)
    least = _worst_of(default.errors, wanted) / CLEARLY if usable else math.inf
    best = default
    with noting_interrupts() as interrupts:
        try:
            for one in search.best(1 if search.stopped == "interrupted" else _FINALISTS):
                interrupts.check()
                judged = judge.judge(one, final)
                if not judged.obstacle and _worst_of(judged.errors, wanted) < least:
                    best, least = judged, _worst_of(judged.errors, wanted)
        except KeyboardInterrupt:
            interrupts.pressed, search.stopped = False, "interrupted"
    if best is default and not usable:
        raise search.refusal(judge.actuator.name, limits)
    return best, default


def _worst_of(errors: np.ndarray, wanted: np.ndarray) -> float:
    """The largest error (n,) among the faults that count, as a share of the range."""
    return float(np.max(errors[wanted > 0.0] * wanted[wanted > 0.0]))


def _observed(judge: Judge, errors: np.ndarray) -> dict[str, float]:
    """Root mean squares by name, of errors (N, n)."""
    return _by_name(judge, np.sqrt((errors**2).mean(axis=0)))


def _by_name(judge: Judge, errors: np.ndarray) -> dict[str, float]:
    """Errors (n,) by the name of the magnitude."""
    return {one.name: float(x) for one, x in zip(judge.magnitudes, errors, strict=True)}


def _worst(shares: Mapping[str, float], fault: str | None) -> float:
    return max(share for name, share in shares.items() if fault in (None, name))
