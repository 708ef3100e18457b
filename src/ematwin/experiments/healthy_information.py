"""Information of a healthy recording on the parameters of an actuator.

The recording is simulated. The covariance C that the parameters would have after it is that which a
calibration states (`ematwin.estimation.correction`): by the Jacobian and the noise, with load and
sensors integrated out, and with the error of the fast model within that width. The scatter of the
reference from one candidate to the next counts as discrepancy (`reference_scatter`, `model_error`).
With P the inverse covariance of the prior, the information is C^-1 - P. The information of several
recordings adds up.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ematwin.errors import InputError
from ematwin.estimation.aliases import aliases_of
from ematwin.estimation.baseline import frees_parameters, uncertain
from ematwin.estimation.corrected_problem import corrected_at, reference_scatter
from ematwin.estimation.correction import Corrected, with_model_error
from ematwin.estimation.healthy_fit import healthy_nuisances
from ematwin.estimation.laplace import width_at
from ematwin.estimation.noise import noise_at
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.experiments.experiment import UNANSWERED, Experiment
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.numerics.symmetric import eigen, inverse
from ematwin.recordings.recording import Recording


@dataclass(frozen=True)
class Knowledge:
    """The d parameters that a calibration fits, as they are known.

    Attributes
    ----------
    unknowns : list of d
    spreads : (d,) array, standard deviations of their logarithms by their tolerances
    prior : of their logarithms
    """

    unknowns: list[Unknown]
    spreads: np.ndarray
    prior: Prior

    @classmethod
    def of(cls, experiment: Experiment) -> "Knowledge":
        """Knowledge of the actuator of an experiment.

        Raises
        ------
        InputError
            If nothing of it is uncertain.
        """
        model, actuator = experiment.model, experiment.actuator
        tolerated = {one.name: one for one in uncertain(model, actuator)}
        fitted = tolerated if frees_parameters(model) else model.nominal
        prior = experiment.baseline.prior
        prior = prior.of(name for name in prior.names if name in fitted and name in tolerated)
        if not prior.names:
            raise InputError(
                f"Nothing of {actuator.name} is uncertain: no parameter that can be fitted has a "
                "tolerance."
            )
        unknowns = [tolerated[name] for name in prior.names]
        return cls(unknowns, np.array([one.spread for one in unknowns], dtype=float), prior)

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse covariance (d, d)."""
        return np.linalg.inv(self.prior.covariance)

    def information(self, covariance: np.ndarray) -> np.ndarray:
        """Information (d, d) that takes the prior to this covariance (d, d).

        Where the model error exceeds its evidence in some direction, a recording adds nothing.
        """
        root = np.linalg.cholesky(self.prior.covariance)
        values, vectors = eigen(root.T @ inverse(covariance) @ root)
        back = np.linalg.solve(root.T, vectors)
        return np.asarray(back * np.maximum(values - 1.0, 0.0) @ back.T)

    def errors(self, precision: np.ndarray) -> dict[str, float]:
        """Standard errors of the logarithms by place, of an inverse covariance (d, d)."""
        found = np.sqrt(np.diag(inverse(precision))).tolist()
        return dict(zip(self.prior.names, found, strict=True))

    def left(self, precision: np.ndarray) -> float:
        """Mean variance, in units of the tolerances, of an inverse covariance (d, d)."""
        return float(np.mean(np.diag(inverse(precision)) / self.spreads**2))


def information_of(
    experiment: Experiment, known: Knowledge, scenario: Scenario, limits: Mapping[str, float]
) -> tuple[np.ndarray, dict[str, float]] | None:
    """Information (d, d) of a test, and its demands by name.

    None where it is beyond the limits, moves too little or cannot be simulated.
    """
    try:
        experiment.move(scenario, limits)  # the fast model: it refuses most at little cost
        recording = experiment.move(scenario, limits, fast=False)
        return _seen(experiment, known, recording), experiment.model.demanded(recording)
    except UNANSWERED:
        return None


def _seen(experiment: Experiment, known: Knowledge, recording: Recording) -> np.ndarray:
    """Information (d, d) of a recording."""
    model, actuator, misfit = experiment.model, experiment.actuator, experiment.baseline.misfit
    comparison = model.compare(recording, actuator, threads=1).with_evidence()
    own = healthy_nuisances(model, actuator, [comparison])
    problem = Problem(
        [comparison], [*known.unknowns, *own], prior=known.prior.and_(Prior.independent(own))
    )
    corrected = corrected_at(problem, problem.start)
    near = corrected or problem
    # what the twin leaves of others
    left = noise_at(near, misfit) if math.isfinite(misfit) else 0.0
    # behind impacts the reference changes from one candidate to the next: no calibration gets below
    scatter = problem.model_error * noise_at(near, reference_scatter(problem, problem.start))
    peak = width_at(
        near, near.start, aliases=aliases_of(model, actuator, near, near.start),
        least_noise=max(near.noise, left, scatter),
    )  # fmt: skip
    end = Corrected(peak, 0 if corrected is None else 1, np.zeros((1, len(peak.z))))
    mine = slice(len(known.unknowns))
    widths = near.chart.widths[mine]
    covariance = with_model_error(end, threads=1).covariance[mine, mine]
    return known.information(covariance * np.outer(widths, widths))
