"""Measurements of each recording before any verdict: its estimate, and features.

Nothing here knows a kind of actuator: the twin is asked through `Problem`, and whatever is
particular to a kind comes from its `Model`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.errors import RecordError
from ematwin.estimation.constants import SAME_COMMAND
from ematwin.estimation.estimate import Estimate
from ematwin.estimation.free_unknowns import searched
from ematwin.estimation.laplace import width_at
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import Found, Search, named
from ematwin.models.base import Model, Monitoring
from ematwin.models.channels_agree import checked
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.phases import phases
from ematwin.monitoring.features import Layout
from ematwin.monitoring.population import basis
from ematwin.recordings.recording import Recording

_SAME_RATE = 0.01
_DIFFERENCE = 2e-3  # share of a range, over which slopes are taken: as long as motions determine it


@dataclass(frozen=True)
class Measured:
    """Measurements on N recordings: all that a verdict rests on.

    Attributes
    ----------
    estimates : one for each recording
    features : (N, F) array
    covariate : (N,) array, SI; zeros for a kind that has none
    groups : (N,) array, number of the run (and condition) of each recording
    barred : of each recording, sentences on channels that forbid a verdict
    """

    estimates: tuple[Estimate, ...]
    features: np.ndarray
    covariate: np.ndarray
    groups: np.ndarray
    barred: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Fit:
    """The twin fitted to each of N recordings.

    Attributes
    ----------
    problems, found : one for each recording
    residuals : (N, C, S) array, of each channel, SI
    covariate : (N,) array, SI; zeros for a kind that has none
    """

    problems: tuple[Problem, ...]
    found: tuple[Found, ...]
    residuals: np.ndarray
    covariate: np.ndarray


class Bench:
    """Recordings over one command beside the twin of one actuator.

    Parameters
    ----------
    model : kind of the actuator
    actuator : of the twin
    recordings : all with the command and the interval given
    command : (S,) array, SI; ``interval`` in s
    settling_time : s, until a transient has died out
    channels : that are compared; all of the first recording if not given

    Attributes
    ----------
    layout : phases and features
    comparisons : one for each recording
    warnings : sentences on doubts, for each recording
    barred : sentences on channels that forbid a verdict, for each recording
    groups : (N,) array, number of the run (and condition) of each recording
    """

    def __init__(
        self,
        model: Model,
        actuator: ParameterSet,
        recordings: Sequence[Recording],
        command: np.ndarray,
        interval: float,
        settling_time: float,
        channels: Sequence[str] | None = None,
    ) -> None:
        self.model, self.actuator, self.recordings = model, actuator, tuple(recordings)
        self._monitoring = Monitoring.of(model)
        found = [check_alike(model, actuator, one, command, interval) for one in recordings]
        self.warnings = [doubts for doubts, _ in found]
        self.barred = [tuple(barred) for _, barred in found]
        self.comparisons: list[Comparison] = [
            self._monitoring.compare(model, one, actuator, settling_time) for one in recordings
        ]
        self.groups = numbered([one.together for one in recordings])
        wanted = tuple(self.comparisons[0].measured() if channels is None else channels)
        for recording, comparison in zip(recordings, self.comparisons, strict=True):
            for name in wanted:
                if name not in comparison.measured():
                    raise RecordError(
                        f"{recording.name} has no {name}, unlike the others; record it, or "
                        "calibrate without it."
                    )
        self.layout = layout_of(model, actuator, command, interval, settling_time, wanted)

    def fit(
        self,
        discrepancy: np.ndarray | None = None,
        scale: float | None = None,
        before: Fit | None = None,
        search: Search | None = None,
    ) -> Fit:
        """Fit the twin to every recording.

        Parameters
        ----------
        discrepancy : (3, C S) or (1, C S) array over the covariate, the error of the twin in the
            channels one after another; taken off first
        scale : of the covariate, as in `Population`
        before : fit without it, from which this one starts; needed with a discrepancy
        search : method; the kind's by default
        """
        name, channels = self._monitoring.covariate, self.layout.channels
        missed = None
        if discrepancy is not None and before is not None:
            missed = self._missed(before.covariate, discrepancy, scale)
        free = searched(self.model, self.actuator)
        problems, found = [], []
        for n, (recording, comparison) in enumerate(
            zip(self.recordings, self.comparisons, strict=True)
        ):
            compared = comparison
            if missed is not None:
                compared = comparison.with_missed(dict(zip(channels, missed[n], strict=True)))
            problem = Problem([compared], free, starts=self.model.starts(self.actuator, recording))
            chosen = named(self.model.default_search) if search is None else search
            if before is not None:
                chosen = LocalDescent(before.found[n].point)
            end = chosen.run(problem, budget=None, seed=1, report=lambda *_: None)
            if end.stopped == "interrupted":
                raise KeyboardInterrupt
            problems.append(problem)
            found.append(end)
        covariate, left = np.zeros(len(found)), []
        for n, (problem, one) in enumerate(zip(problems, found, strict=True)):
            if name is not None:
                covariate[n] = problem.values(one.point)[name]
            answer = self.comparisons[n].responses(problem.candidates(one.point[None]), 1)
            measured = self.comparisons[n].measured()
            left.append([measured[channel] - answer[channel][0] for channel in channels])
        residuals = np.array(left)
        if discrepancy is not None:
            residuals -= self._missed(covariate, discrepancy, scale)
        return Fit(tuple(problems), tuple(found), residuals, covariate)

    def _missed(
        self, covariate: np.ndarray, discrepancy: np.ndarray, scale: float | None
    ) -> np.ndarray:
        """Error (N, C, S) of the twin at covariates (N,)."""
        rows = basis(covariate, scale) @ discrepancy
        return rows.reshape(len(rows), len(self.layout.channels), -1)

    def measured(self, fit: Fit) -> Measured:
        """Estimates with their covariance, and features."""
        from ematwin.estimation.identify import estimate_of

        estimates, features = [], []
        for n, (recording, problem, found) in enumerate(
            zip(self.recordings, fit.problems, fit.found, strict=True)
        ):
            judged = found.problem or problem
            estimate = estimate_of(
                self.actuator, problem, found.point, spread_at(judged, found.point),
                problem.relative_misfit(found.cost), recording,
            )  # fmt: skip
            estimates.append(replace(estimate, warnings=tuple(self.warnings[n])))
            values = problem.values(found.point)
            features.append(self.layout.values(values, fit.residuals[n]))
        return Measured(
            tuple(estimates), np.stack(features), fit.covariate, self.groups,
            tuple(self.barred),
        )  # fmt: skip


def spread_at(problem: Problem, point: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the values at a minimum (d,), in values.

    The residual of the twin counts as noise times `Problem.model_error`.
    """
    peak = width_at(problem, point, information=np.eye(len(point)) / _DIFFERENCE**2)
    chart, covariance = problem.chart, peak.widened(problem.model_error)
    errors = chart.standard_errors(peak.z, covariance)
    errors *= np.where([one.logarithmic for one in problem.unknowns], point, 1.0)
    sizes = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(sizes, sizes) * np.outer(errors, errors))


def layout_of(
    model: Model,
    actuator: ParameterSet,
    command: np.ndarray,
    interval: float,
    settling_time: float,
    channels: Sequence[str],
) -> Layout:
    """The features of recordings over a command."""
    magnitudes = [one.name for one in model.faults(actuator) if one.direction_of is None]
    return Layout.of(
        phases(command, interval, settling_time), magnitudes, channels, Monitoring.of(model).short
    )


def reported_values(
    model: Model, actuator: ParameterSet, layout: Layout, features: np.ndarray
) -> np.ndarray:
    """Reported values (N, R), SI; logarithms of values that are multiples of healthy."""
    by_name = dict(zip(layout.names, features.T, strict=True))
    monitoring = Monitoring.of(model)
    derived = monitoring.derived(by_name)
    columns = []
    for one in monitoring.reported(model, actuator):
        values = by_name[one.name] if one.name in layout.magnitudes else derived[one.name]
        # a derived quantity comes as the logarithm
        log = one.logarithmic and one.name in layout.magnitudes
        columns.append(np.log(values) if log else values)
    return np.column_stack(columns)


def slopes_of(model: Model, actuator: ParameterSet, layout: Layout) -> np.ndarray:
    """Slopes (R, F) of reported values by features."""
    healthy = np.ones(len(layout.names))  # multiples are 1
    away = reported_values(model, actuator, layout, healthy + _DIFFERENCE * np.eye(len(healthy)))
    slopes = (away - reported_values(model, actuator, layout, healthy[None])) / _DIFFERENCE
    return np.asarray(slopes.T)


def numbered(keys: Sequence[tuple[str, ...]]) -> np.ndarray:
    """Number (N,) of each key, equal for equal keys, in the order of their first appearance."""
    order = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    return np.array([order[key] for key in keys])


def check_alike(
    model: Model,
    actuator: ParameterSet,
    recording: Recording,
    command: np.ndarray,
    interval: float,
) -> tuple[list[str], list[str]]:
    """Doubts about a recording, and reasons that forbid a verdict (`checked`).

    Raises
    ------
    RecordError
        Unless it follows a command at a rate.
    """
    model.check_channels(recording)
    channel = model.channel(model.command)
    travel = float(np.ptp(command))
    if travel <= 0.0:
        raise RecordError(
            f"The {channel.meaning} ({channel.name}) of {recording.name} never moves; a recording "
            "is needed in which the actuator does."
        )
    if abs(recording.interval - interval) > _SAME_RATE * interval:
        raise RecordError(
            f"{recording.name} is sampled every {recording.interval:g} s where {interval:g} s is "
            "needed; resample it, or calibrate for this rate."
        )
    own = recording.channels[model.command]
    if own.size != command.size:
        raise RecordError(
            f"{recording.name} has {own.size} samples where {command.size} are needed: it is "
            "another motion, or cut short. Leave it out, or calibrate for it."
        )
    off = float(np.abs(own - command).max())
    if off > SAME_COMMAND * travel:
        raise RecordError(
            f"{recording.name} follows another command: it is off by up to {off:.4g} "
            f"{channel.unit} of {travel:.4g} {channel.unit} of travel. Leave it out, calibrate for "
            "it, or correct its unit."
        )
    return checked(model, recording, actuator)


def statistics_of(estimates: Sequence[Estimate]) -> Mapping[str, np.ndarray]:
    """Statistics (N,) of the estimates by name; those that all of them have."""
    if not estimates:
        return {}
    common = [
        name for name in estimates[0].statistics if all(name in one.statistics for one in estimates)
    ]
    return {name: np.array([one.statistics[name] for one in estimates]) for name in common}
