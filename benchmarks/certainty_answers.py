"""What each method says of a recording that was drawn, as a row of plain values.

``laplace``, ``profile`` and ``posterior`` are those of `ematwin.identify`. Those with ``own``
behind them count the noise of the recording alone, without the factor for what the twin gets wrong
in the same way throughout (`Model.model_error`): on recordings of the twin itself it gets nothing
wrong, and ranks tell whether draws are right only without it.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from counted import MAGNITUDES
from ematwin import identify
from ematwin.estimation.intervals import Draws
from ematwin.estimation.posterior import Posterior
from ematwin.estimation.spike_and_slab import fault_sets
from ematwin.estimation.uncertainty import (
    LaplaceIntervals,
    Method,
    Question,
    Report,
    Uncertainty,
)
from populations import drawn

EFFECTIVE = 100.0  # samples of the worst component: enough to count, and a quarter of the default
_SAME = 1e-9  # draws and truth at one bound


@dataclass(frozen=True)
class LaplaceOwn:
    """Laplace's intervals from the noise of the recording alone."""

    name: str = "laplace own"

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """The answer, without a simulation."""
        peak = question.joint.peaks[0]
        sets = fault_sets(peak.problem.chart, peak.unbounded(1.0), peak.widened(1.0))
        own = replace(question, assessed=replace(question.assessed, sets=sets))
        found = LaplaceIntervals().run(own, seed=seed, report=report)
        ends = {
            one.name: sets.given(one.direction_of or one.name).interval(
                one.name, one.lower, one.upper
            )
            for one in peak.problem.unknowns
        }
        return replace(found, method=self.name, intervals=ends, doubts=())


@dataclass(frozen=True)
class PosteriorOwn:
    """The posterior from the noise of the recording alone."""

    name: str = "posterior own"

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """Its draws."""
        own = replace(question.joint, factor=1.0)
        return Posterior(EFFECTIVE).run(replace(question, joint=own), seed=seed, report=report)


METHODS: Mapping[str, str | Method] = {
    "laplace": LaplaceIntervals(), "profile": "profile", "posterior": Posterior(EFFECTIVE),
    "laplace own": LaplaceOwn(), "posterior own": PosteriorOwn(),
}  # fmt: skip


def judged(
    population: str, knowledge: str, fidelity: str, seed: int, method: str
) -> dict[str, Any]:
    """Values, intervals, probabilities, ranks and verdict beside the truth."""
    one = drawn(population, knowledge, fidelity, seed)
    started = time.process_time()
    found = identify(
        one.recording, one.known, exact=one.exact, threads=1, uncertainty=METHODS[method], seed=seed
    )
    seconds = time.process_time() - started
    sure = found.uncertainty
    assert sure is not None
    return {
        "truth": one.faults,
        "others": one.others,
        "values": {name: found.values[name] for name in one.faults},
        "errors": {name: found.standard_error[name] for name in MAGNITUDES},
        "intervals": {name: sure.intervals.get(name, found.intervals[name]) for name in one.faults},
        "present": sure.present,
        "healthy": sure.healthy,
        "ranks": None if sure.method == "profile" else ranks(sure.draws, one.faults),
        "converged": _converged(sure),
        "fitted": found.fitted,
        "grade": found.verdict.grade,
        "named": found.verdict.faults,
        "reason": found.verdict.reason,
        "misfit": found.relative_misfit,
        "seconds": seconds,
    }


def ranks(found: Draws, truth: Mapping[str, float]) -> dict[str, float]:
    """Share of draws below the truth, by name; of a direction, of those up to half a turn before.

    Draws that equal the truth, at a bound, count by half.
    """
    shares = {}
    for name, value in truth.items():
        away = found.of(name) - value
        if name in found.directions:
            away = (away + 0.5) % 1.0 - 0.5
        shares[name] = float(np.mean((away < -_SAME) + 0.5 * (np.abs(away) <= _SAME)))
    return shares


def _converged(sure: Uncertainty) -> bool | None:
    diagnostics = getattr(sure, "diagnostics", None)
    return None if diagnostics is None else bool(diagnostics.converged)
