"""Profiles and posteriors: ematwin's beside those of pyPESTO, on the same density.

pyPESTO (pip install pypesto emcee) is given half the deviance of `ematwin.estimation.joint.Joint`
and, for profiles, its gradient by differences from one batch, which costs as much as one point. All
start from the answer of one `identify`; eccentricity and its direction are held, so that
coordinates are values. One thread. ematwin samples until it has the effective samples that its
default asks for; pyPESTO gets a number of simulations, and its effective samples are counted by the
same rule.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from benchmarks.peers.measure import Line, Part, missing, number, progress, versions

from ematwin import Noise, identify, simulate
from ematwin.estimation.joint import Joint
from ematwin.estimation.posterior import Posterior
from ematwin.estimation.profile import Profiles
from ematwin.estimation.uncertainty import (
    LaplaceIntervals,
    Method,
    Question,
    Report,
    Uncertainty,
)

FREE = ("friction", "backlash", "short_a", "short_b", "short_c", "gain")
SHOWN = ("friction", "backlash", "short_b", "gain")
INJECTED = {"friction": 0.3, "backlash": 0.2, "short_a": 0.05, "short_b": 0.25, "gain": 0.45}
STEP = 1e-3  # of differences, share of a range
STEPS = (1e-5, 2e-4, 2e-3)  # of pyPESTO's profiles; its own, 1e-3 and up, are wider than a profile
SAMPLES, WALKERS = 3000, 24
EFFECTIVE, QUICK = 400.0, 20
LIMIT = 0.1465  # ratio of likelihoods at the end of an interval of 95 %, exp(-3.841/2)


@dataclass
class Asked:
    """Keeps the question that `identify` asks."""

    name: str = "asked"
    questions: list[Question] = field(default_factory=list)

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """Laplace's answer."""
        self.questions.append(question)
        return LaplaceIntervals().run(question, seed=seed, report=report)


class Density:
    """Half the deviance of a joint density, one point or a batch.

    Attributes
    ----------
    evaluations : simulations of all densities; of the class, for pyPESTO works on copies
    """

    evaluations = 0

    def __init__(self, joint: Joint) -> None:
        self.joint, self.chart = joint, joint.problem.chart
        Density.evaluations = 0

    def values(self, z: np.ndarray) -> np.ndarray:
        """(B,) of points of the chart (B, d); infinite outside the bounds."""
        Density.evaluations += len(z)
        found = np.full(len(z), np.inf)
        within = self.joint.inside(z)
        if within.any():
            found[within] = 0.5 * self.joint.deviance(self.joint.residuals(z[within]))
        return found

    def value(self, z: np.ndarray) -> float:
        """At one point (d,)."""
        return float(self.values(z[None])[0])

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """(d,) by differences to both sides, within the bounds, from one batch."""
        up = np.minimum(z + STEP, self.chart.upper)
        down = np.maximum(z - STEP, self.chart.lower)
        own = np.eye(len(z), dtype=bool)
        found = self.values(np.concatenate([np.where(own, up, z), np.where(own, down, z)]))
        return np.asarray((found[: len(z)] - found[len(z) :]) / (up - down))


Interval = tuple[float, float]


@dataclass(frozen=True)
class Answer:
    """CPU seconds, simulations, intervals by fault, and what the method says of itself."""

    seconds: float
    evaluations: int
    intervals: dict[str, Interval]
    remark: str = ""


def question() -> Question:
    """One recording of the reference model, identified."""
    record = simulate(faults=INJECTED, noise=Noise(white=0.02, bits=12), seed=5)
    asked = Asked()
    identify(record, exact=True, only=FREE, threads=1, uncertainty=asked)
    return asked.questions[0]


def by_ematwin(asked: Question, method: Method) -> Answer:
    """Ours."""
    spent = [0]
    started = time.process_time()
    found = method.run(asked, seed=1, report=lambda done, most: spent.append(done))
    seconds = time.process_time() - started
    diagnostics = getattr(found, "diagnostics", None)
    remark = "" if diagnostics is None else f"{min(diagnostics.effective.values()):.0f} effective"
    count = max(spent) if diagnostics is None else diagnostics.evaluations
    return Answer(seconds, count, {n: found.intervals[n] for n in SHOWN}, remark)


def _pypesto(density: Density, start: np.ndarray) -> tuple[Any, Any]:
    """Its problem, and its result with the best point."""
    import pypesto
    import pypesto.optimize

    logging.getLogger("pypesto").setLevel(logging.ERROR)
    objective = pypesto.Objective(fun=density.value, grad=density.gradient)
    chart = density.chart
    problem = pypesto.Problem(
        objective, lb=chart.lower, ub=chart.upper, x_names=list(FREE), x_guesses=start[None]
    )
    optimizer = pypesto.optimize.ScipyOptimizer("L-BFGS-B")
    result = pypesto.optimize.minimize(
        problem, optimizer, n_starts=1, progress_bar=False, filename=None
    )
    return problem, result


def profiles_by_pypesto(asked: Question) -> Answer:
    """Its profiles, in steps as short as these need; ends where the likelihood ratio says."""
    import pypesto.optimize
    import pypesto.profile

    density = Density(asked.joint)
    started = time.process_time()
    problem, result = _pypesto(density, asked.joint.peaks[0].z)
    shortest, usual, longest = STEPS
    options = pypesto.profile.ProfileOptions(
        ratio_min=LIMIT, min_step_size=shortest, default_step_size=usual, max_step_size=longest
    )
    result = pypesto.profile.parameter_profile(
        problem, result, pypesto.optimize.ScipyOptimizer("L-BFGS-B"),
        profile_options=options, progress_bar=False, filename=None,
    )  # fmt: skip
    seconds = time.process_time() - started
    intervals = {}
    for n, one in enumerate(result.profile_result.list[0]):
        if FREE[n] in SHOWN:
            path = density.chart.to_values(one.x_path.T)[:, n]
            intervals[FREE[n]] = _ends(path, one.ratio_path)
    return Answer(seconds, density.evaluations, intervals)


def _ends(values: np.ndarray, ratios: np.ndarray) -> Interval:
    """Where a profile falls through the limit, or ends; the root of its logarithm is straight."""
    order = np.argsort(values)
    values = values[order]
    roots = np.sqrt(np.maximum(-np.log(np.maximum(ratios[order], 1e-300)), 0.0))
    limit = np.sqrt(-np.log(LIMIT))
    inside = np.flatnonzero(roots <= limit)
    ends = []
    for edge, beyond in ((inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)):
        if not 0 <= beyond < len(values):
            ends.append(float(values[edge]))
            continue
        share = (limit - roots[edge]) / (roots[beyond] - roots[edge])
        ends.append(float(values[edge] + share * (values[beyond] - values[edge])))
    return ends[0], ends[1]


def samples_by_pypesto(asked: Question, sampler: str, count: int) -> Answer:
    """Its samples: adaptive Metropolis, or emcee point by point."""
    import pypesto.sample
    from emcee.autocorr import integrated_time

    density = Density(asked.joint)
    started = time.process_time()
    problem, result = _pypesto(density, asked.joint.peaks[0].z)
    if sampler == "emcee":
        chosen: Any = pypesto.sample.EmceeSampler(nwalkers=WALKERS, run_args={"progress": False})
        count //= WALKERS
    else:
        chosen = pypesto.sample.AdaptiveMetropolisSampler(options={"show_progress": False})
    np.random.seed(1)  # noqa: NPY002 - pyPESTO draws from the global state
    result = pypesto.sample.sample(problem, count, chosen, result=result, filename=None)
    seconds = time.process_time() - started
    chain = np.asarray(result.sample_result.trace_x)[0]
    chain = chain[len(chain) // 3 :]
    tau = integrated_time(chain, tol=0, quiet=True)
    values = density.chart.to_values(chain)
    cuts = {n: np.quantile(values[:, FREE.index(n)], [0.025, 0.975]) for n in SHOWN}
    intervals = {name: (float(low), float(high)) for name, (low, high) in cuts.items()}
    if sampler == "emcee":  # its trace mixes the walkers: their times are not those of a chain
        return Answer(seconds, density.evaluations, intervals)
    effective = float(len(chain) / np.nanmax(tau))
    return Answer(seconds, density.evaluations, intervals, f"{effective:.0f} effective")


def run(*, quick: bool, repeats: int) -> Part:
    """Both profiles and posteriors, in turn."""
    asked = question()
    posterior = Posterior(QUICK if quick else EFFECTIVE)
    samples = 600 if quick else SAMPLES
    work = {
        "profiles, ematwin": lambda: by_ematwin(asked, Profiles()),
        "posterior, ematwin": lambda: by_ematwin(asked, posterior),
    }
    remarks = []
    if gone := missing("pypesto", "pypesto", "pyPESTO"):
        remarks.append(gone)
    else:
        work["profiles, pyPESTO, L-BFGS-B"] = lambda: profiles_by_pypesto(asked)
        work["posterior, pyPESTO, adaptive Metropolis"] = lambda: samples_by_pypesto(
            asked, "metropolis", samples
        )
        work["posterior, pyPESTO, emcee"] = lambda: samples_by_pypesto(asked, "emcee", samples)
    found: dict[str, list[Answer]] = {name: [] for name in work}
    for n in range(repeats):
        for name, one in work.items():
            progress(f"uncertainty {n + 1}/{repeats}: {name}")
            found[name].append(one())
    lines = [_line(name, answers, found) for name, answers in sorted(found.items())]
    return Part(
        heading="Profiles and posterior",
        question=__doc__.split("\n")[0],
        unit="CPU s",
        ratio="over ematwin",
        columns=("simulations", *SHOWN, ""),
        lines=tuple(lines),
        remarks=tuple(remarks),
        versions=versions("pypesto", "emcee"),
    )


def _line(name: str, answers: Sequence[Answer], found: dict[str, list[Answer]]) -> Line:
    own = found[f"{name.split(',')[0]}, ematwin"]
    last = answers[-1]
    ends = [f"{last.intervals[n][0]:.4f} to {last.intervals[n][1]:.4f}" for n in SHOWN]
    return Line(
        name,
        tuple(one.seconds for one in answers),
        tuple(a.seconds / b.seconds for a, b in zip(answers, own, strict=True)),
        (number(last.evaluations), *ends, last.remark),
        own="ematwin" in name,
    )
