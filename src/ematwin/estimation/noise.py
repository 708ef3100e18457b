"""Noise and model discrepancy of a problem, as its residuals show them.

Noise is the standard deviation of an independent residual, the unit in which priors and evidence
count. What noise does not explain is a discrepancy.
"""

import math

import numpy as np

from ematwin.estimation.problem import Problem


def noise_at(problem: Problem, misfit: float) -> float:
    """Standard deviation of an independent residual that leaves a relative misfit."""
    scale = sum(one.scale for one in problem.comparisons)
    return misfit * math.sqrt(scale / sum(one.independent for one in problem.comparisons))


def with_shown_noise(problem: Problem, residuals: np.ndarray, least_noise: float = 0.0) -> Problem:
    """The same problem with the noise that residuals (K,) at a good point show.

    Evidence counts by the noise of its channels, where that is more than was expected.
    """
    left = problem.split(residuals)
    noise = max(_noise_of(problem, left.data), least_noise)
    if not problem.has_evidence:
        return problem.with_noise(noise)
    count = sum(one.independent for one in problem.comparisons if one.evidence)
    unit = problem.noise * problem.trust
    found = float(np.sqrt(left.evidence @ left.evidence / count)) / unit
    return problem.with_noise(noise, trust=1.0 / max(1.0, found))


def _noise_of(problem: Problem, data: np.ndarray) -> float:
    """Standard deviation of an independent residual, from those that are left, (K,)."""
    scale = sum(one.scale for one in problem.comparisons)
    independent = sum(one.independent for one in problem.comparisons)
    return float(np.sqrt((data @ data) / independent)) or 1e-9 * float(np.sqrt(scale))


def with_channels_reweighed(problem: Problem, point: np.ndarray) -> Problem | None:
    """The problem with each channel weighed by the noise that a good point (d,) leaves of it.

    None where nothing changes.
    """
    parts = [
        one.reweighed(problem.residuals_of(n, point[None])[0])
        for n, one in enumerate(problem.comparisons)
    ]
    if all(new is old for new, old in zip(parts, problem.comparisons, strict=True)):
        return None
    return problem.with_comparisons(parts).with_noise(parts[0].noise)


def with_discrepancy(problem: Problem, cost: float, scatter: float) -> Problem:
    """The same problem, where noise and scatter explain but a part of the cost at a minimum.

    The rest, the discrepancy, is alike throughout a recording: standard errors that take it for
    noise are too small by the factor that the kind states (`Comparison.model_error`).

    Parameters
    ----------
    problem : corrected by the reference
    cost : of the data at the minimum
    scatter : what of it impacts and ripple of the reference leave
    """
    scale = sum(one.scale for one in problem.comparisons)
    left = max(0.0, cost - problem.recorded_misfit**2 * scale - scatter)
    share = left / cost if left else 0.0
    factor = problem.comparisons[0].model_error
    return problem.with_noise(problem.noise, model_error=math.sqrt(1.0 - share + share * factor**2))
