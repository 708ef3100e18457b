"""The test command with the smallest expected errors within limits: `design`.

An optimal design of an experiment (Atkinson, Donev and Tobias 2007, Optimum Experimental Designs,
with SAS, chapters 10 and 17): of the commands of `ematwin.experiments.candidates` that one is
chosen whose expected standard error (`ematwin.experiments.command_errors`)

    of one named fault, everything else being a nuisance (Ds-optimal), or
    of the fault that is worst in share of its range (min-max),

is least. The best few are compared again at other faults, and `identify` answers simulated
recordings of the best of these and of the given command, all of the same actuators. A few
recordings are luck as well: the given one stays unless the other is expected to err clearly less
and errs clearly less.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError, whole_number
from ematwin.estimation.interrupt import until_interrupted
from ematwin.experiments.candidates import FINALISTS, SECONDS, Progress, Ranking, ranked
from ematwin.experiments.command_errors import (
    CommandErrors,
    Faults,
    expected_errors,
    fault_vectors,
    identified_errors,
    judged,
    observed,
    shown_by,
)
from ematwin.experiments.experiment import BEYOND, Experiment, excess
from ematwin.experiments.identifiability import identifiability
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from ematwin.showing.results import drawn, plain

DRAWS = 6
CLEARLY = 1.1  # ratio of errors, expected and of `identify`, from which another command is chosen


@dataclass(frozen=True)
class Design:
    """Command that was found, beside the given one."""

    promised: CommandErrors  #: errors of the command that was found
    default: CommandErrors  #: errors of the given one in the same duration
    fault: str | None  #: the fault it was made for; None for the weakest
    limits: dict[str, float]  #: that it keeps, by name, SI
    #: counts as known while commands are compared, because none of them determines it
    held: tuple[str, ...]
    draws: int  #: fault vectors over which the errors are averaged
    left_out: int  #: further ones, at which the given command does not determine the same faults
    evaluations: int  #: commands that were compared
    seconds: float
    stopped: str  #: complete, budget, time or interrupted
    seed: int
    experiment: Experiment = field(repr=False)  #: the actuator, its uncertainty, and the noise
    #: whether the errors observed come from `check`; else from those by which it was chosen
    checked: bool = False

    @property
    def actuator(self) -> ParameterSet:
        """For which it was made."""
        return self.experiment.actuator

    @property
    def scenario(self) -> Scenario:
        """The command."""
        return self.promised.scenario

    @property
    def gain(self) -> float:
        """Error of the default over error of the design, for the fault that it was made for."""
        return self.default.worst(self.fault) / self.promised.worst(self.fault)

    @property
    def observed_gain(self) -> float | None:
        """The same with the errors that `identify` made; None where none were."""
        if not self.promised.observed or not self.default.observed:
            return None
        before, after = (
            one.worst(self.fault, observed=True) for one in (self.default, self.promised)
        )
        return before / after

    @property
    def left_out_sentence(self) -> str:
        """On fault vectors that do not count; "" where all do."""
        if not self.left_out:
            return ""
        return (
            f"Left out of the mean: {self.left_out} of {self.draws + self.left_out} drawn fault "
            "vectors, at which nothing moves or a fault does not show under the given command."
        )

    @property
    def sentence(self) -> str:
        """The gain, in words."""
        what = f"the standard error of {self.fault}"
        if self.fault is None:
            what = "the largest standard error (share of the range)"
        if not math.isfinite(self.gain):
            return (
                "Not all faults can be identified with the given command; with this one they can, "
                f"{self.promised.weakest} least well."
            )
        if self.scenario == self.default.scenario:
            return (
                f"No command within the limits was found that lowers {what}; the given one stays."
            )
        beyond = "The given command is beyond the limits. " * (self.default.obstacle == BEYOND)
        if self.gain < 1.0:
            return (
                f"{beyond}Of the commands within them this one has the smallest errors: {what} is "
                f"{1.0 / self.gain:.1f} times that with the given command."
            )
        if self.observed_gain is None:
            return (
                f"{beyond}This one is expected to lower {what} {self.gain:.1f} times; no recording "
                "was identified to see whether it does."
            )
        which = "other simulated recordings" if self.checked else "simulated recordings"
        return (
            f"{beyond}This one lowers {what} about {min(self.gain, self.observed_gain):.1f} times: "
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
        seed : of faults, parameters and noise; another than the design's
        step : float, s, of the model that is recorded; None takes the actuator's
        progress : called with the share done

        Returns
        -------
        Design, also after Ctrl-C: with the recordings that were done; itself if there are none
        """
        if recordings < 1:
            raise InputError(f"recordings must be at least 1, received {recordings}.")
        scenarios = [self.scenario, self.default.scenario]
        errors = identified_errors(
            self.experiment, scenarios, recordings, seed=seed, step=step, progress=progress
        )
        promised, default = observed((self.promised, self.default), errors)
        if promised is self.promised:
            return self
        return replace(self, promised=promised, default=default, checked=True)

    def save(self, path: str | Path) -> None:
        """Write the command as a scenario file (TOML), whole or not at all."""
        self.scenario.save(path)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return plain({
            "actuator": self.actuator.name, "fault": self.fault, "sentence": self.sentence,
            "gain": self.gain, "observed_gain": self.observed_gain, "limits": self.limits,
            "held": self.held, "fault_vectors": self.draws, "left_out": self.left_out,
            "promised": self.promised.as_dict(), "default": self.default.as_dict(),
            "evaluations": self.evaluations, "seconds": self.seconds, "stopped": self.stopped,
            "seed": self.seed,
        })  # fmt: skip


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
    fresh: int = 16,  # fault vectors on which the best commands are compared anew
    trials: int = 8,  # recordings of each command: its root mean square error is known to a fifth
    budget: int | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
    trying: Callable[[float], object] | None = None,
    **limits: float,
) -> Design:
    """The command with the smallest expected error of the weakest fault, or a named one.

    Parameters
    ----------
    actuator : a parameter set of any kind, its name or file; calibrated or not
    fault : the fault to identify; None takes the one of largest error, as a share of its range
    scenario : a command that is compared with the others, and whose demands are the limits where
        none are given; a `Scenario`, the name of a shipped one, or a file. None takes the kind's
        default
    duration : float, s; None takes the scenario's
    faults : values of some faults; the others are drawn
    noise : of the sensors; None for that which the kind simulates by itself
    exact : parameters, load and sensors are known exactly
    sample_rate : float, Hz; None takes the kind's
    draws : fault vectors over which errors are averaged in the first comparison
    fresh : others, on which the best commands and the given one are compared anew
    trials : simulated recordings of the best command, and of the given one, that are identified
        before one is chosen: the given one stays unless the other errs clearly less. 0 relies on
        the expected errors. Without a budget as many as half a minute allows
    budget : commands that are compared, or more until one can be used; None takes all, or as many
        as a minute allows
    seed : of the fault vectors, the noise and the order of the commands
    threads : that share a batch; None takes one for each core
    progress : called after each command
    trying : called with the share of the trials that is done
    limits : the largest travel, speed, current, load, in SI; others are limited by the
        demands of the scenario. `Model.demands` has the names

    Returns
    -------
    Design, also after Ctrl-C: the best found so far, ``stopped == "interrupted"``

    Raises
    ------
    InputError
        If an argument cannot be used, or no command keeps the limits.
    """
    started = time.perf_counter()
    for name, count, least in (("draws", draws, 1), ("fresh", fresh, 1), ("trials", trials, 0)):
        whole_number(count, name, least)
    experiment, held = Experiment.of(
        actuator, exact=exact, noise=noise, sample_rate=sample_rate, seed=seed, threads=threads
    ).knowing_aliases()
    model, chosen = experiment.model, experiment.actuator
    given = experiment.started(scenario, duration)
    limits = experiment.limits(limits)
    if fault is not None:
        experiment.check_magnitude(fault)
    known = model.values_of(chosen, faults or {})
    fixed = {name: known[name] for name in faults or {}}

    def shown(count: int, seed: int) -> list[Faults]:
        vectors = fault_vectors(experiment, count, np.random.default_rng(seed), fixed, even=True)
        return shown_by(experiment, given, vectors, fault)

    some = shown(draws, seed)
    within = experiment.demanded(given) | limits

    def cost_of(command: Scenario, healthy: Recording, enough: float) -> float:
        return expected_errors(
            experiment, command, some, model.demanded(healthy), fast=True, fault=fault,
            enough=enough,
        ).worst(fault)  # fmt: skip

    found = ranked(experiment, given, within, cost_of, budget=budget, seed=seed, progress=progress)
    others = shown(fresh, seed + 1)
    final = experiment.demanded(given, fast=False) | limits
    best, default = _finalists(found, experiment, given, final, others, fault)
    if default.obstacle and best is default:
        raise found.refusal(chosen.name, limits)
    both = [default] if best is default else [best, default]
    asked = trials if len(both) > 1 and found.stopped != "interrupted" else 0
    errors = identified_errors(
        # seeds of trials lie so far from those of the comparison and of `Design.check`
        experiment, [one.scenario for one in both], asked, seed=7919 + seed, progress=trying,
        seconds=SECONDS / 2.0 if budget is None else math.inf,
    )  # fmt: skip
    if len(errors) < asked:
        found.stopped = "interrupted"
    both = observed(both, errors)
    if both[0].checks and not default.obstacle:
        first, second = (one.worst(fault, observed=True) for one in both)
        if CLEARLY * first > second:
            both = both[1:]
    both = [
        replace(one, told=identifiability(
            one.scenario, actuator, faults=fixed, noise=noise, exact=exact,
            sample_rate=sample_rate, seed=seed, threads=threads,
        )) for one in both
    ]  # fmt: skip
    return Design(
        both[0], both[-1], fault, final, held, draws=len(others), left_out=fresh - len(others),
        evaluations=found.evaluations, seconds=time.perf_counter() - started,
        stopped=found.stopped, seed=seed, experiment=experiment,
    )  # fmt: skip


def _finalists(
    found: Ranking, experiment: Experiment, given: Scenario, limits: Mapping[str, float],
    vectors: Sequence[Faults], fault: str | None,
) -> tuple[CommandErrors, CommandErrors]:  # fmt: skip
    """The best command and the given one, compared at fresh faults."""
    # the best of many at a few faults is so by chance as well: another has to err clearly less
    default = judged(experiment, given, {}, vectors)
    if not default.obstacle and excess(default.demands, limits) > 0.0:
        default = replace(default, obstacle=BEYOND)
    best = default
    least = math.inf if default.obstacle else default.worst(fault) / CLEARLY
    with until_interrupted() as interrupts:
        for one in found.commands[: 1 if found.stopped == "interrupted" else FINALISTS]:
            interrupts.check()
            errors = judged(experiment, one, limits, vectors)
            if not errors.obstacle and errors.worst(fault) < least:
                best, least = errors, errors.worst(fault)
    if interrupts.ended:
        found.stopped = "interrupted"
    return best, default
