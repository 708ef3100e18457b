"""Sensitivity of an answer: Sobol indices of the compared channels.

The share of the variance of an answer that each unknown causes, over the faults that begin and the
95 % intervals of parameters, load and sensors (each evenly over its range): by itself (first
order), and with all interactions (total). `identifiability` looks at slopes, this at ranges.

An answer is a function of time. Indices of its samples are weighed by their variance
(Gamboa, Janon, Klein and Lagnoux 2014, Electron. J. Stat. 8, 575-603, "generalised" indices):

    S_i = sum_t V_i(t) / sum_t V(t),

with V_i estimated from two samples A and B, and A with the column i of B (Saltelli et al. 2010,
Comput. Phys. Commun. 181, 259-270, table 2, b and f): mean(f(B) (f(AB_i) - f(A))) alone, and
mean((f(A) - f(AB_i))^2)/2 with all interactions.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.problem import Problem
from ematwin.experiments.command_errors import SEVEREST
from ematwin.experiments.experiment import Experiment
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.numerics.sobol import Sobol
from ematwin.recordings.noise import Noise
from ematwin.showing.results import plain

SAMPLES = 256  # a power of two; an answer is simulated for each and each unknown
_AT_A_TIME = 512  # answers that are held whole


@dataclass(frozen=True)
class Sensitivity:
    """Sobol indices of an answer."""

    scenario: Scenario  #: the command
    actuator: ParameterSet  # of the twin
    names: tuple[str, ...]  #: of the d unknowns
    first: dict[str, np.ndarray]  #: (d,) by channel
    total: dict[str, np.ndarray]  #: (d,) by channel
    first_error: dict[str, np.ndarray]  #: standard errors of these, by bootstrap
    total_error: dict[str, np.ndarray]  #: the same of the total indices
    captions: dict[str, str]  #: title of each channel
    answers: int  #: how many were simulated

    def rows(self, channel: str, least: float = 0.01) -> list[list[str]]:
        """Name, first and total index with standard errors, the largest first, down to a least."""
        first, total = self.first[channel], self.total[channel]
        return [
            [
                self.names[n],
                f"{first[n]:.2f} +- {self.first_error[channel][n]:.2f}",
                f"{total[n]:.2f} +- {self.total_error[channel][n]:.2f}",
            ]
            for n in np.argsort(-total)
            if total[n] >= least
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        left_out = ("scenario", "actuator", "captions")
        return plain({n: x for n, x in vars(self).items() if n not in left_out})


def sensitivity(
    scenario: Scenario | str | Path | None = None,
    actuator: ParameterSet | str | Path | Any | None = None,
    *,
    exact: bool = False,
    samples: int = SAMPLES,
    sample_rate: float | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Sensitivity:
    """Sobol indices of the answer to a command.

    Parameters
    ----------
    scenario, actuator, sample_rate, threads : as in `ematwin.identifiability`
    exact : only faults are drawn
    samples : N; (d + 2) N answers are simulated
    seed : of the samples
    progress : called with the share done

    Raises
    ------
    InputError
        If an argument cannot be used.
    """
    if samples < 2 or samples & (samples - 1):
        raise InputError(f"samples must be a power of two, received {samples}.")
    experiment = Experiment.of(
        actuator, exact=exact, noise=Noise(), sample_rate=sample_rate, seed=seed, threads=threads
    )
    chosen = experiment.actuator
    asked = experiment.model.load_scenario(scenario)
    full = experiment.problem(experiment.record(asked))
    unknowns = full.unknowns
    points = sampled(np.array([_range(full, one) for one in unknowns]), samples, seed)
    logarithmic = np.array([one.logarithmic for one in unknowns])
    points[..., logarithmic] = np.exp(points[..., logarithmic])
    rng = np.random.default_rng(seed)
    found: dict[str, np.ndarray] = {}  # by channel, (4, d): indices and their standard errors
    for name, answers in _answers(full, points.reshape(-1, len(unknowns)), progress).items():
        rows = answers.reshape(*points.shape[:2], -1)
        rows = rows[:, np.isfinite(rows).all(axis=(0, 2))]
        kept = rows.shape[1]
        if kept < samples // 2:
            raise InputError(
                f"The twin of {chosen.name} diverged in most of its range; narrow its tolerances."
            )
        picks = [np.arange(kept), *rng.integers(kept, size=(100, kept))]  # of a bootstrap
        drawn = np.array([indices(rows[:, pick]) for pick in picks])
        found[name] = np.concatenate([drawn[0], drawn[1:].std(axis=0)])
    first, total, first_error, total_error = (
        {name: one[n] for name, one in found.items()} for n in range(4)
    )
    captions = {name: one[0] for name, one in full.comparisons[0].captions().items()}
    return Sensitivity(
        asked, chosen, tuple(one.name for one in unknowns), first, total, first_error, total_error,
        captions, points.shape[0] * samples,
    )  # fmt: skip


def _answers(
    problem: Problem, points: np.ndarray, progress: Callable[[float], object] | None
) -> dict[str, np.ndarray]:
    """Answers (N, S) by channel at points (N, d), thinned to some samples."""
    comparison = problem.comparisons[0]
    thin = slice(None, None, max(1, len(comparison.recording) // 200))  # samples of an answer
    found: dict[str, list[np.ndarray]] = {}
    for begin in range(0, len(points), _AT_A_TIME):
        some = points[begin : begin + _AT_A_TIME]
        for name, trace in comparison.responses(problem.candidates(some), len(some)).items():
            found.setdefault(name, []).append(trace[:, thin].copy())
        if progress is not None:
            progress((begin + len(some)) / len(points))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def sampled(bounds: np.ndarray, samples: int, seed: int) -> np.ndarray:
    """Points (d + 2, N, d) within bounds (d, 2): A, A with a column of B in turn, and B."""
    d = len(bounds)
    a, b = np.split(Sobol(2 * d, np.random.default_rng(seed)).random(samples), 2, axis=1)
    mixed = [np.where(np.arange(d) == k, b, a) for k in range(d)]
    return np.asarray(bounds[:, 0] + np.array([a, *mixed, b]) * np.ptp(bounds, axis=1))


def indices(answers: np.ndarray) -> np.ndarray:
    """First and total generalised indices (2, d) of answers (d + 2, N, S) at `sampled` points."""
    a, mixed, b = answers[0], answers[1:-1], answers[-1]
    variance = np.var(answers[[0, -1]], axis=(0, 1)).sum()
    first = ((b - b.mean(axis=0)) * (mixed - a)).mean(axis=1).sum(axis=1)
    total = 0.5 * ((a - mixed) ** 2).mean(axis=1).sum(axis=1)
    return np.asarray([first / variance, total / variance])


def _range(full: Problem, one: Unknown) -> tuple[float, float]:
    """Bounds between which an unknown is drawn; of its logarithm, if that has the prior."""
    low, high = one.lower, one.upper
    if one.name in full.prior.names:
        n = full.prior.names.index(one.name)
        mean, reach = full.prior.mean[n], TWO_SIGMA * math.sqrt(full.prior.covariance[n, n])
        ends = (mean - reach, mean + reach)
        ends = (math.exp(ends[0]), math.exp(ends[1])) if one.logarithmic else ends
        low, high = max(ends[0], low), min(ends[1], high)
    elif one.direction_of is None:
        low = one.healthy - SEVEREST * (one.healthy - low)
        high = one.healthy + SEVEREST * (high - one.healthy)
    return (math.log(low), math.log(high)) if one.logarithmic else (low, high)
