"""The command that tells a fault best, within what a test may demand: `design`.

An optimal design of an experiment (Atkinson, Donev and Tobias 2007, Optimum Experimental Designs,
with SAS, chapters 10 and 17): the numbers of a scenario are chosen so that the expected standard
error (`ematwin.estimation.promise`)

    of one named fault, everything else being a nuisance (Ds-optimal), or
    of the fault that is worst in share of its range (min-max),

is least. Differential evolution searches the box of `DesignSpace`, from the scenario itself; the
best few are judged again at other faults, and tried (`ematwin.estimation.trial`).
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
    BUDGET,
    CommandSearch,
    Looked,
    Progress,
    begun,
    demands_of,
    excess,
    limits_of,
)
from ematwin.estimation.identifiability import Identifiability, identifiability
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.promise import DRAWS, FRESH, Judge, Judged, drawn_faults, fault_shares
from ematwin.estimation.trial import CLEARLY, TRIALS, TRIED, Tried, best_of, tried
from ematwin.models.base import Demand, Model, no_unknown
from ematwin.models.designed import DesignSpace
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.recordings.noise import Noise
from ematwin.showing.drawing import drawn

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
        return _worst(self.default, self.fault) / _worst(self.promised, self.fault)

    @property
    def observed_gain(self) -> float | None:
        """The same with the errors that were observed; None where none were."""
        if not self.promised.observed or not self.default.observed:
            return None
        widths = {one.name: one.width for one in self.judge.magnitudes}
        before, after = (
            max(
                error / widths[name]
                for name, error in one.observed.items()
                if self.fault in (None, name)
            )
            for one in (self.default, self.promised)
        )
        return before / after

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
        from ematwin.estimation.observed import observe

        if recordings < 1:
            raise InputError(f"recordings must be at least 1, received {recordings}.")
        scenarios = {"promised": self.scenario, "default": self.default.scenario}
        errors = observe(
            self.judge, list(scenarios.values()), recordings, seed=seed, step=step,
            progress=progress,
        )  # fmt: skip
        if not len(errors):
            return self
        found = {
            name: replace(
                getattr(self, name),
                observed={
                    one.name: float(rms)
                    for one, rms in zip(
                        self.judge.magnitudes, np.sqrt((errors[:, n] ** 2).mean(0)), strict=True
                    )
                },
                checks=len(errors),
            )
            for n, name in enumerate(scenarios)
        }
        return replace(self, **found, checked=True)

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
    trials : simulated recordings of each of the most promising commands, and of the given one, that
        are identified before one is chosen: the given one stays unless another errs clearly less.
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
    within = limits_of(model, judge.judge(given, draft=True).demands, limits)

    def look(command: Scenario, limit: float) -> Looked:
        one = judge.judge(
            command, within, draft=True, enough=lambda errors: _worst_of(errors, wanted) > limit
        )
        return Looked(_worst_of(one.errors, wanted), one.demands, one.obstacle)

    search = CommandSearch(DesignSpace(model, given, within), within, look)
    search.run(budget, seed, progress)
    final = judge.at(
        drawn_faults(model, chosen, fault_shares(model, chosen, fresh, seed + 1), held)
    )
    found, default = _decided(search, final, given, limits, wanted, trials, _OTHERS + seed, trying)
    told = [
        identifiability(
            one.judged.scenario, actuator, faults=held, noise=noise, exact=exact,
            sample_rate=sample_rate, seed=seed, threads=threads,
        )
        for one in (found, default)
    ]  # fmt: skip
    return Design(
        promised=_promise(found, judge.magnitudes, told[0]),
        default=_promise(default, judge.magnitudes, told[1]),
        actuator=chosen,
        fault=fault,
        limits=limits_of(model, default.judged.demands, limits),
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


def _decided(
    search: CommandSearch,
    judge: Judge,
    given: Scenario,
    limits: Mapping[str, float],
    wanted: np.ndarray,
    trials: int,
    seed: int,
    trying: Callable[[float], object] | None,
) -> tuple[Tried, Tried]:
    """The best of the finalists and the given command: judged at fresh faults, whole, then tried.

    The search has fitted its best commands to the few faults that it looked at.
    """
    default = judge.judge(given)
    final = limits_of(judge.model, default.demands, limits)
    usable = not default.obstacle and excess(default.demands, final) == 0.0
    least = _worst_of(default.errors, wanted) if usable else math.inf
    better: list[Judged] = []
    with noting_interrupts() as interrupts:
        try:
            for one in search.best(1 if search.stopped == "interrupted" else _FINALISTS):
                interrupts.check()
                judged = judge.judge(one, final)
                if not judged.obstacle and CLEARLY * _worst_of(judged.errors, wanted) < least:
                    better.append(judged)
        except KeyboardInterrupt:
            interrupts.pressed, search.stopped = False, "interrupted"
    better.sort(key=lambda one: _worst_of(one.errors, wanted))
    commands = [default, *better[:TRIED]]
    if not better:
        if not usable:
            raise search.refusal(judge.actuator.name, limits)
        commands = commands[:1]
    asked = trials if better and search.stopped != "interrupted" else 0
    first, *others = tried(judge, commands, asked, seed, trying)
    if first.recordings < asked:
        search.stopped = "interrupted"
    best = best_of(first if usable else None, others, lambda errors: _worst_of(errors, wanted))
    return best, first


def _worst_of(errors: np.ndarray, wanted: np.ndarray) -> float:
    """The largest error (n,) among the faults that count, as a share of the range."""
    return float(np.max(errors[wanted > 0.0] * wanted[wanted > 0.0]))


def _promise(one: Tried, magnitudes: tuple[Unknown, ...], told: Identifiability) -> Promise:
    judged = one.judged
    errors = {o.name: float(e) for o, e in zip(magnitudes, judged.errors, strict=True)}
    return Promise(
        scenario=judged.scenario,
        errors=errors,
        shares={o.name: errors[o.name] / o.width for o in magnitudes},
        demands=judged.demands,
        faulty=judged.faulty,
        told=told,
        observed=one.observed([o.name for o in magnitudes]),
        checks=one.recordings,
    )


def _worst(promise: Promise, fault: str | None) -> float:
    return max(share for name, share in promise.shares.items() if fault in (None, name))
