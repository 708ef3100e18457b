"""Traces along each fault, in steps of about equal rise of the deviance.

From the best point on a fault is moved to both sides; after each step everything else descends
again (Levenberg-Marquardt), from where the last two points put it. All traces go together, as one
batch of the lanes. `ematwin.estimation.profile` reads them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ematwin.estimation.constants import DECIDES
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.joint import Joint
from ematwin.estimation.levenberg_marquardt import LevenbergMarquardt
from ematwin.estimation.uncertainty import Question, Report
from ematwin.models.chart import Chart
from ematwin.models.unknown import Unknown

BETTER = 1.0  # fall of the deviance that shows that the search had not converged
_STRIDE = 0.9  # of the root of the rise
_STEPS = 16  # at most
_TOO_STEEP = 2.5  # strides that one may climb; else it is repeated at half its length
_SHORTEST = 0.1  # of the first stride: what is still too steep there is a step of the misfit


@dataclass
class Trace:
    """Points along one fault to one side.

    Attributes
    ----------
    place : of the fault among the unknowns
    sign : of the steps
    chart : of the points
    first_stride, stride : float, of the first step and of the next
    tangent : (d,) array, how everything moves with the fault at first
    path : points (d,) and their deviances
    """

    place: int
    sign: int
    chart: Chart
    first_stride: float
    stride: float
    tangent: np.ndarray
    path: list[tuple[np.ndarray, float]]

    def ended(self, least: float) -> bool:
        """Whether the fault has come to the end of its range, or the deviance has risen enough."""
        last, deviance = self.path[-1]
        at_bound = last[self.place] <= 0.0 if self.sign < 0 else last[self.place] >= 1.0
        return bool(at_bound or deviance - least >= DECIDES)

    def next(self) -> np.ndarray:
        """The next point (d,), in line with the last two."""
        n, last, tangent = self.place, self.path[-1][0], self.tangent
        target = np.clip(last[n] + self.sign * self.stride, 0.0, 1.0)
        if len(self.path) > 1 and last[n] != self.path[-2][0][n]:
            tangent = last - self.path[-2][0]
            tangent = tangent / tangent[n]
        u = self.chart.project((last + (target - last[n]) * tangent)[None])[0]
        u[n] = target
        return u

    def adapt(self, least: float) -> None:
        """Choose the next stride by the rise of the last; repeat that where it was too long."""
        (before, first), (after, then) = self.path[-2:]
        gone = abs(after[self.place] - before[self.place])
        climbed = math.sqrt(max(then - least, 0.0)) - math.sqrt(max(first - least, 0.0))
        # where the model diverged nothing is known of what lies between
        again = gone > _SHORTEST * self.first_stride or not math.isfinite(climbed)
        if climbed > _TOO_STEEP * _STRIDE and again:
            self.path.pop()
            self.stride = 0.5 * gone
            return
        ratio = _STRIDE / max(climbed, 1e-9)
        self.stride = gone * min(max(ratio, 0.5), 2.5)


class Tracer:
    """Two traces of each fault, down and up, all of them together.

    A magnitude with a direction is traced in both as they are (`polar`): in the components of its
    vector it is no coordinate. The others are traced in those, where a magnitude of zero may grow
    to every side.

    Attributes
    ----------
    faults : (n,) unknowns
    traces : (2 n,), of each fault down and up
    errors : (d,) array, standard errors in the coordinates of the problem's chart
    evaluations : int
    """

    def __init__(self, question: Question) -> None:
        self.joint: Joint = question.joint
        self.faults: Sequence[Unknown] = question.faults
        self.evaluations = 0
        self.chart = chart = self.joint.problem.chart
        self.polar = Chart([replace(one, direction_of=None) for one in chart.unknowns])
        for _, direction in chart.pairs:  # once round and further
            self.polar.lower[direction], self.polar.upper[direction] = -np.inf, np.inf
        self.covariance = self.joint.normals[0].covariance
        self.errors = np.sqrt(np.diag(self.covariance))
        self.sharp = question.assessed.sharp_errors
        self.traces: list[Trace] = []

    @property
    def least(self) -> float:
        """The least deviance so far."""
        return self._lowest()[1]

    @property
    def fall(self) -> float:
        """How far below the best point a trace went."""
        return self.traces[0].path[0][1] - self.least

    def _lowest(self) -> tuple[np.ndarray, float]:
        """The lowest point (1, d) so far, in the problem's chart, and its deviance."""
        every = [(deviance, u, one.chart) for one in self.traces for u, deviance in one.path]
        deviance, u, chart = min(every, key=lambda point: point[0])
        return self._z(u[None], chart), deviance

    def run(self, report: Report) -> bool:
        """Trace until all rises are large enough; False if Ctrl-C ended it."""
        normal = self.joint.normals[0]
        starts = np.stack([normal.z, normal.mean])
        with noting_interrupts() as interrupts:
            try:
                for _ in range(3):  # from a lower point that a trace found, at most
                    self.traces = self._begun(starts)
                    for step in range(_STEPS):
                        for chart in (self.chart, self.polar):
                            self._step([t for t in self.traces if t.chart is chart], chart)
                            interrupts.check()
                        report(self.evaluations, self.evaluations * _STEPS // (step + 1))
                    if self.fall < BETTER:
                        break
                    starts = self._lowest()[0]
            except KeyboardInterrupt:
                if not self.traces:
                    raise
                return False
        return True

    def _begun(self, starts: np.ndarray) -> list[Trace]:
        """Traces at the lowest point below starts (M, d).

        The search minimises the misfit; with the model's own error priors count for more.
        """
        starts = self.chart.project(starts)
        low, high = (np.tile(end, (len(starts), 1)) for end in (self.chart.lower, self.chart.upper))
        points, deviances = self._descended(starts, self.chart, low, high, 10)
        best = int(np.argmin(deviances))
        z, least = points[best], float(deviances[best])
        traces = []
        for one in self.faults:
            n = self.joint.problem.names.index(one.name)
            chart, stride, u = self.chart, self.errors[n], z
            tangent = self.covariance[:, n] / self.covariance[n, n]
            if any(n == magnitude for magnitude, _ in self.chart.pairs):
                chart, stride = self.polar, self.sharp[one.name] / self.chart.widths[n]
                u, tangent = chart.from_values(self.chart.to_values(z[None]))[0], np.zeros(len(z))
            stride = _STRIDE * min(stride, 1.0)
            traces += [
                Trace(n, sign, chart, stride, stride, tangent, [(u, least)]) for sign in (-1, 1)
            ]
        return traces

    def _step(self, traces: list[Trace], chart: Chart) -> None:
        """One stride of each trace that has not ended, and a descent of everything else."""
        least = self.least
        going = [one for one in traces if not one.ended(least)]
        if not going:
            return
        points = np.array([one.next() for one in going])
        low, high = (np.tile(end, (len(going), 1)) for end in (chart.lower, chart.upper))
        for m, one in enumerate(going):
            low[m, one.place] = high[m, one.place] = points[m, one.place]
        found = self._descended(points, chart, low, high, 4)
        for one, u, deviance in zip(going, *found, strict=True):
            one.path.append((u, float(deviance)))
        for one in going:
            one.adapt(self.least)

    def _descended(
        self, points: np.ndarray, chart: Chart, low: np.ndarray, high: np.ndarray, iterations: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (M, d) after a descent within bounds (M, d), and their deviances (M,)."""

        def residuals(u: np.ndarray) -> np.ndarray:
            self.evaluations += len(u)
            return self.joint.residuals(self._z(u, chart))

        descent = LevenbergMarquardt.start(points, residuals)
        for _ in range(iterations):
            descent.iterate(residuals, low, high, chart.project)
        return descent.points, self.joint.deviance(descent.residuals)

    def _z(self, u: np.ndarray, chart: Chart) -> np.ndarray:
        """Convert coordinates (B, d) of another chart to the problem's chart."""
        return u if chart is self.chart else self.chart.from_values(chart.to_values(u))
