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
from ematwin.monitoring.population import HealthyRuns, basis
from ematwin.recordings.recording import Recording

_SAME_RATE = 0.01
DIFFERENCE = 2e-3  # share of a range, over which slopes are taken: as long as motions determine it


@dataclass(frozen=True)
class Measured:
    """Measurements on N recordings: all that a verdict rests on."""

    estimates: tuple[Estimate, ...]
    barred: tuple[tuple[str, ...], ...]  # of each, sentences on channels that forbid a verdict
    # as in `ematwin.monitoring.population.HealthyRuns`
    features: np.ndarray
    errors: np.ndarray
    covariate: np.ndarray
    groups: np.ndarray
    statistics: Mapping[str, np.ndarray]

    def healthy(self, features: np.ndarray, runs: Sequence[str]) -> HealthyRuns:
        """These as healthy ones, with other features (N, F), and the run of each."""
        return HealthyRuns(
            features, self.errors, self.covariate, self.groups, tuple(runs), self.statistics
        )


@dataclass(frozen=True)
class Fit:
    """The twin fitted to each of N recordings."""

    problems: tuple[Problem, ...]
    found: tuple[Found, ...]
    residuals: np.ndarray  # (N, C, S), of each channel, SI
    covariate: np.ndarray  # (N,), SI; zeros for a kind that has none


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
        self._doubts = [check_alike(model, actuator, one, command, interval) for one in recordings]
        self.comparisons: list[Comparison] = [
            self._monitoring.compare(model, one, actuator, settling_time) for one in recordings
        ]
        together = {key: n for n, key in enumerate(dict.fromkeys(r.together for r in recordings))}
        self.groups = np.array([together[one.together] for one in recordings])
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
        problems, found, left = [], [], []
        covariate = np.zeros(len(self.recordings))
        for n, comparison in enumerate(self.comparisons):
            compared = comparison
            if missed is not None:
                compared = comparison.with_missed(dict(zip(channels, missed[n], strict=True)))
            starts = self.model.starts(self.actuator, self.recordings[n])
            problem = Problem([compared], free, starts=starts)
            chosen = named(self.model.default_search) if search is None else search
            if before is not None:
                chosen = LocalDescent(before.found[n].point)
            end = chosen.run(problem, budget=None, seed=1, report=lambda *_: None)
            if end.stopped == "interrupted":
                raise KeyboardInterrupt
            if name is not None:
                covariate[n] = problem.values(end.point)[name]
            answer = comparison.responses(problem.candidates(end.point[None]), 1)
            measured = comparison.measured()
            left.append([measured[channel] - answer[channel][0] for channel in channels])
            problems.append(problem)
            found.append(end)
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
        for n, (problem, found) in enumerate(zip(fit.problems, fit.found, strict=True)):
            estimate = estimate_of(
                self.actuator, problem, found.point,
                spread_at(found.problem or problem, found.point),
                problem.relative_misfit(found.cost), self.recordings[n],
            )  # fmt: skip
            estimates.append(replace(estimate, warnings=tuple(self._doubts[n][0])))
            features.append(self.layout.values(problem.values(found.point), fit.residuals[n]))
        errors = [
            [min(one.standard_errors[name], one.ranges[name]) for name in self.layout.magnitudes]
            for one in estimates
        ]
        common = set.intersection(*(set(one.statistics) for one in estimates))
        return Measured(
            tuple(estimates),
            tuple(tuple(barred) for _, barred in self._doubts),
            np.stack(features),
            np.array(errors, dtype=float).reshape(len(features), len(self.layout.magnitudes)),
            fit.covariate,
            self.groups,
            {name: np.array([one.statistics[name] for one in estimates])
             for name in estimates[0].statistics if name in common},
        )  # fmt: skip


def spread_at(problem: Problem, point: np.ndarray) -> np.ndarray:
    """Covariance (d, d) of the values at a minimum (d,), in values.

    The residual of the twin counts as noise times `Problem.model_error`.
    """
    peak = width_at(problem, point, information=np.eye(len(point)) / DIFFERENCE**2)
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
