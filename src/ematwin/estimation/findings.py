"""Sentences on an assessed recording: the verdict or why there is none, and doubtful values.

`ematwin.estimation.verdict` decides; this module gathers its grounds.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from ematwin.errors import EmatwinError
from ematwin.estimation.assess import Assessment
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.constants import HOPELESS, TELLING, WORSE, WORST
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.intervals import Interval
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found
from ematwin.estimation.verdict import (
    INTERVAL,
    Verdict,
    judged,
    most_misfit,
    most_of_healthy,
)
from ematwin.models.base import Model
from ematwin.models.channels_agree import LATEST
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.proposing import in_other_units
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.showing.text import (
    capital,
    in_unit,
    listed,
    number_of,
    said_between,
    with_interval,
)

_VAGUE = 0.05  # standard error, as a share of the range, above which a fault is not determined


def verdict_on(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    assessed: Assessment,
    baseline: Baseline,
    obstacles: Sequence[str],
) -> Verdict:
    """The verdict on a recording, or why there is none; after an interruption there is not."""
    sets = assessed.sets
    if sets is None:
        return Verdict.none(" ".join(obstacles))
    faults = [one for one in problem.unknowns if one.role == "fault" and one.direction_of is None]
    return judged(
        sets.probabilities,
        sets.faulty,
        sets.beyond(TELLING),
        calibrated=baseline.calibrated,
        reach={
            one.name: max(abs(end - one.healthy) for end in assessed.intervals[one.name])
            / one.width
            for one in faults
        },
        found={one.name: size_of(one, actuator, *assessed.physical[one.name]) for one in faults},
        ranges={one.name: range_of(one, actuator, *assessed.physical[one.name]) for one in faults},
        obstacles=obstacles,
        ambiguities={
            name: one.ambiguity
            for one in model.contrasts(actuator)
            if one.ambiguity
            for name in one.weights
        },
    )


def obstacles_to(
    load: str | None,
    recording: Recording,
    problem: Problem,
    found: Found,
    misfit: float,
    assessed: Assessment,
    baseline: Baseline,
) -> list[str]:
    """Reasons that each forbid a verdict, as sentences; ``load`` names the kind's channel of it."""
    told = []
    if found.stopped == "interrupted":
        told.append("The search was interrupted; these values are the best found until then.")
    counts = recording.provenance.get("saturated_samples", {})
    for name, count in counts.items():
        if count > 0.01 * len(recording):
            told.append(
                f"{name} is saturated in {100.0 * count / len(recording):.0f} % of its samples. "
                "Record it with a wider range."
            )
    missing = load is not None and load not in recording.channels
    if missing and load not in problem.held and baseline.has_load:
        but = ", and the healthy ones had" if baseline.calibrated else "; it was taken as zero"
        told.append(
            f"The recording has no {load}{but}. Record it, or say what it was (load=0 if there was "
            "none)."
        )
    has_reference = problem.comparisons[0].has_reference
    limit, beside = most_misfit(baseline.misfit, has_reference, assessed.scatter), ""
    if found.problem is not None:
        misfit = found.problem.relative_misfit(assessed.cost)
    known = None if assessed.joint is None else assessed.joint.peaks[0].problem.information
    if known is not None and known.whole and baseline.recordings:
        # errors of the equations count in the intervals; behind encoders and near instability
        # answers of the reference within these differ by as much as a recording from any of them
        limit = max(WORST, min(HOPELESS, WORSE * max(baseline.misfit, assessed.scatter)))
        if known.unexplained > WORST:
            beside = f" along its motion (in closed loop {100.0 * misfit:.2g} %)"
            misfit, limit = known.unexplained, WORST
    elif has_reference and baseline.misfit > most_of_healthy(
        baseline.expected_misfit, problem.lacks_forms
    ):
        told.append(
            f"In closed loop the twin leaves {100.0 * baseline.misfit:.2g} % of the healthy "
            "recordings of this actuator unexplained: what it lacks may pass for a fault. Record "
            "the load and all currents and positions, here and for calibrate."
        )
    if misfit > max(limit, WORSE * problem.expected_misfit):
        usual = f"a good fit leaves less than {100.0 * limit:.2g} %"
        if baseline.recordings and limit == WORSE * baseline.misfit:
            usual = f"healthy recordings left {100.0 * baseline.misfit:.2f} %"
        elif limit == WORSE * assessed.scatter:
            usual = f"its answers within the intervals differ by {100.0 * assessed.scatter:.2g} %"
        told += [unexplained(misfit, usual, beside), *late_channel(problem, assessed.values)]
    else:
        told += _unexplained_channel(problem, assessed, baseline, limit)
    if assessed.strained:
        told.append(implausible(*max(assessed.strained.items(), key=lambda one: one[1])))
    return told


def unexplained(misfit: float, usual: str, beside: str = "") -> str:
    """Sentence: the twin leaves a relative misfit; ``usual`` states the usual one.

    ``beside`` says of what it is, where there is another one.
    """
    left = f"{100.0 * misfit:.0f}" if misfit > 0.1 else f"{100.0 * misfit:.2g}"
    return (
        f"The twin leaves {left} % of this recording unexplained{beside}, where {usual}: it does "
        "something that the twin cannot. Check channels, units, the load and the actuator."
    )


def _unexplained_channel(
    problem: Problem, assessed: Assessment, baseline: Baseline, limit: float
) -> list[str]:
    """A sentence on the channel that is explained worst, if that is worse than the noise stated.

    One that counts much hides in the misfit of all what is wrong with others.
    """
    left = problem.comparisons[0].left({**problem.held, **assessed.values})
    unusual = {
        name: one.share
        for name, one in left.items()
        if one.share > limit and one.times > WORSE * max(1.0, baseline.left.get(name, 0.0))
    }
    if not unusual:
        return []
    name = max(unusual, key=lambda name: unusual[name])
    return [
        f"The twin explains the recording as a whole, but leaves {100.0 * unusual[name]:.2g} % of "
        f"{name} unexplained: check that sensor, its sign, its unit, and the actuator."
    ]


def implausible(name: str, away: float) -> str:
    """Sentence: a parameter, load or sensor is so many standard deviations from its prior."""
    return (
        f"To explain this recording {name} would have to be {away:.0f} standard deviations off "
        "what is known of it: it is of another actuator, or something is wrong with a channel."
    )


def late_channel(problem: Problem, values: Mapping[str, float]) -> list[str]:
    """A sentence on the channel that fits much better once it is taken earlier, if there is one.

    Laws of a kind tell a late sensor before the fit (`ematwin.models.channels_agree`); this serves
    kinds without laws.
    """
    one = problem.comparisons[0]
    answers = one.responses({name: np.array([value]) for name, value in values.items()}, 1)
    interval = one.recording.interval
    tried = []
    for name, target in one.measured().items():
        fitted = answers[name][0]
        most = min(round(LATEST / interval), len(target) // 20)
        left = [
            float(np.sqrt(np.mean((target[lag:] - fitted[: len(fitted) - lag]) ** 2)))
            for lag in range(most + 1)
        ]
        lag = int(np.argmin(left))
        if 0 < lag < most and left[lag] < 0.5 * left[0]:  # RMS, the delay taken off
            tried.append((left[lag] / left[0], name, lag))
    if not tried:
        return []
    share, name, lag = min(tried)
    return [
        f"Taken {1e3 * lag * interval:.2g} ms earlier, {name} fits {1.0 / share:.2g} times as "
        "well: check whether its sensor or bus delays it."
    ]


def size_of(one: Unknown, actuator: ParameterSet, value: float, ends: Interval) -> str:
    """The size of a fault: "friction +50 % (0.045 N m, 95 % interval 0.044 to 0.047)".

    Where nothing is healthy: "6.0 shorted turns in phase b (95 % interval 5.8 to 8.0)". Value and
    interval are physical.
    """
    row = one.physical_value(actuator, one.healthy)
    number, between = said_between(value, ends.low, ends.high, row.unit)
    name, between = one.name.replace("_", " "), f"{INTERVAL} {between}"
    if row.healthy > 0.0:
        low, now, high = (x / row.healthy for x in (ends.low, value, ends.high))
        if now < 3.0:
            percent = with_interval(*(100.0 * (x - 1.0) for x in (now, low, high)))[0]
            size = f"{percent} %" if percent.startswith("-") else f"+{percent} %"
        else:
            size = f"x{with_interval(now, low, high)[0]}"
        return f"{name} {size} ({number}, {between})"
    if row.unit in one.meaning.split() and number.endswith(f" {row.unit}"):
        return f"{number.removesuffix(row.unit)}{one.meaning} ({between})"
    return f"{name} {number} ({between})"


def range_of(one: Unknown, actuator: ParameterSet, value: float, ends: Interval) -> str:
    """Where a fault lies: "short a, 0 to 2.2 turns"; with the healthy value where it has one."""
    row = one.physical_value(actuator, one.healthy)
    _, between = said_between(value, ends.low, ends.high, row.unit)
    healthy = f", healthy {number_of(row.healthy, row.unit, 3)}" if row.healthy else ""
    return f"{one.name.replace('_', ' ')}, {in_unit(between, preferred(row.unit)[0])}{healthy}"


def remarks_on(model: Model, actuator: ParameterSet, assessed: Assessment) -> list[str]:
    """Sentences on load and sensors that clearly differ from the recording and were estimated."""
    found = []
    for name, (value, ends) in assessed.nuisances.items():
        one = model.unknown(actuator, name)
        number, between = said_between(value, ends.low, ends.high, one.unit)
        meant = capital(one.meaning)
        found.append(f"{meant} is {number} ({between}); that was taken into account.")
    faults = {one.name for one in model.faults(actuator) if one.direction_of is None}
    moved = [name for name in assessed.unsettled if name in faults]
    if moved:
        found.append(
            f"After {assessed.reference_runs} answers of the reference model {listed(moved)} still "
            "moved by more than a standard error; the intervals are wider by that."
        )
    for other in assessed.others:
        answer = ", ".join(f"{name} {value:.2g}" for name, value in other.items())
        found.append(f"Another answer explains the recording nearly as well: {answer}.")
    if assessed.trust < 0.33:  # share of its weight with which evidence counts
        found.append(
            "The recorded voltages or the current of the supply differ from the twin "
            f"{1.0 / assessed.trust:.0f} times as much as they should, and count accordingly less. "
            "Check their units, their signs and the order of the phases."
        )
    return found


def doubts_of(
    estimate: Estimate, found: Found, problem: Problem, sharp_errors: Mapping[str, float]
) -> list[str]:
    """Sentences on why the answer may be wrong."""
    doubts = []
    misfit = estimate.misfit
    if found.problem is not None:
        stretch_cost = float(found.problem.costs(found.point[None])[0])
        length = found.problem.comparisons[0].length or math.nan
        doubts.append(
            f"Over the whole record the twin departs from the actuator (misfit "
            f"{100.0 * misfit:.1f} %), as happens near stall. The faults are those that best "
            f"explain stretches of {1e3 * length:g} ms, each from its recorded positions "
            f"(misfit {100.0 * found.problem.relative_misfit(stretch_cost):.2f} %)."
        )
    elif misfit > HOPELESS:
        doubts += _fitting_units(problem)
        doubts.append(
            f"The twin does not explain this record at all (misfit {100.0 * misfit:.0f} %; no twin "
            "leaves 100 %): these values mean nothing. Check the channels and their units, and "
            "that the parameters belong to this rig."
        )
    vague = [name for name, error in sharp_errors.items() if error > _VAGUE * estimate.ranges[name]]
    for name, magnitude in estimate.directions.items():
        if name in vague and magnitude in estimate.names and estimate[magnitude] < 0.02:
            vague.remove(name)  # it has no meaning there
    if vague:
        doubts.append(
            f"This record does not determine {', '.join(vague)}: other values would explain it "
            "nearly as well. Use a command that moves the actuator more."
        )
    return doubts


def _fitting_units(problem: Problem) -> list[str]:
    """A sentence on the units with which the healthy twin explains a recording, if it is theirs."""
    one = problem.comparisons[0]
    model = model_of(one.actuator)
    tried: list[tuple[float, dict[str, str]]] = []
    for units, scaled in in_other_units(one.recording, model, one.actuator):
        with suppress(EmatwinError):
            other = Problem.of(scaled, one.actuator)
            point = np.array([[each.healthy for each in other.unknowns]])
            tried.append((other.relative_misfit(float(other.costs(point)[0])), units))
    stated = next((misfit for misfit, units in tried if not units), math.inf)
    best, units = min(tried, key=lambda each: each[0], default=(math.inf, {}))
    if not units or best > 1.0 or best > 0.3 * stated:  # SI may be what was meant
        return []
    said = listed([f'unit = "{unit}" for {name}' for name, unit in units.items()])
    return [
        f"Nobody stated the units, and SI was taken: the healthy twin leaves "
        f"{100.0 * best:.0f} % unexplained with {said}, and {100.0 * stated:.0f} % in SI. If that "
        "is what they are, state it in the map or in the names of the file, as in "
        f"“{next(iter(units))} [{next(iter(units.values()))}]”."
    ]
