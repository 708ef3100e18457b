"""Posterior draws of everything that is unknown, by an ensemble of walkers.

emcee (Foreman-Mackey et al. 2013, Publ. Astron. Soc. Pac. 125, 306-312) moves all walkers as one
batch of the lanes, by differential evolution (ter Braak 2006, Stat. Comput. 16, 239-249). Walkers
start from draws of Laplace's approximation around all minima that the search found, and change
between these by `Jump`.

Convergence: autocorrelation time by Sokal's window as emcee has it (Goodman and Weare 2010, Commun.
Appl. Math. Comput. Sci. 5, 65-80), and split R-hat (Gelman et al. 2013, section 11.4) of groups of
walkers by where they started, so that walkers which stay in their minima show (nested R-hat:
Margossian et al. 2024, Bayesian Anal.).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ematwin.errors import InputError, MissingExtraError
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.intervals import Draws, with_corner
from ematwin.estimation.joint import Joint
from ematwin.estimation.spike_and_slab import FaultSets
from ematwin.estimation.uncertainty import (
    Question,
    Report,
    Uncertainty,
    by_sets,
    strained,
    uninformed,
)
from ematwin.numerics.linear_algebra import eigen

GROUPS = 4  # of walkers
# 1.01 is for one quantity; the largest of some thirty is more where each has 400 effective samples
RHAT = 1.02
_LONG_ENOUGH = 10.0  # autocorrelation times that a chain must last for its own to be believed
_LEAST_WALKERS, _LANES = 64, 32
_FIRST, _GROWTH = 150, 1.5  # steps until chains are looked at, and how many times more then
_BURN_IN = 1.0 / 3.0  # share of the steps that is left out
_TOO_FAR = 4.0  # standard deviations of a chi-squared distribution


@dataclass(frozen=True)
class Diagnostics:
    """Diagnostics of chains of W walkers and T steps.

    Attributes
    ----------
    rhat, tau, effective : by name of the coordinate: split R-hat, autocorrelation time in steps,
        effective samples
    steps, walkers : numbers kept
    evaluations : int, simulations altogether
    acceptance : float, share of the proposals that were accepted
    wanted : float, effective samples that were asked for
    """

    rhat: dict[str, float]
    tau: dict[str, float]
    effective: dict[str, float]
    steps: int
    walkers: int
    evaluations: int
    acceptance: float
    wanted: float

    @property
    def worst(self) -> str:
        """The coordinate with the fewest effective samples."""
        return min(self.effective, key=lambda name: self.effective[name])

    @property
    def largest_rhat(self) -> tuple[str, float]:
        """Of all coordinates."""
        return max(self.rhat.items(), key=lambda one: one[1])

    @property
    def converged(self) -> bool:
        """Whether all coordinates have converged."""
        return (
            self.effective[self.worst] >= self.wanted
            and self.largest_rhat[1] < RHAT
            and self.steps >= _LONG_ENOUGH * max(self.tau.values())
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; infinite ones are null."""
        rhat = {name: one if np.isfinite(one) else None for name, one in self.rhat.items()}
        return {**vars(self), "rhat": rhat, "converged": self.converged}

    def __str__(self) -> str:
        name, largest = self.largest_rhat
        return (
            f"{self.effective[self.worst]:.0f} effective samples of {self.worst} (the fewest), "
            f"largest R-hat {largest:.3f} ({name}), longest autocorrelation time "
            f"{max(self.tau.values()):.0f} steps of {self.steps}, {self.walkers} walkers, "
            f"{self.evaluations} simulations, {100.0 * self.acceptance:.0f} % accepted"
        )


@dataclass(frozen=True)
class PosteriorUncertainty(Uncertainty):
    """Draws of a posterior, with diagnostics of the chains that they come from.

    Attributes
    ----------
    diagnostics : of the chains
    valleys : probability of each minimum that the search found, the best fit first
    chains : (T, W, d) values along the walkers, in the order of ``draws.names``
    log_density : (T, W)
    """

    diagnostics: Diagnostics | None = None
    valleys: tuple[float, ...] = ()
    chains: np.ndarray | None = None
    log_density: np.ndarray | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        assert self.diagnostics is not None
        own = {"valleys": list(self.valleys), "diagnostics": self.diagnostics.as_dict()}
        return {**super().as_dict(), **own}

    @property
    def sentences(self) -> list[str]:
        """Probabilities in words, the diagnostics last."""
        said = super().sentences
        if len(self.valleys) > 1:
            shares = ", ".join(f"{100.0 * share:.0f} %" for share in self.valleys)
            said.append(f"Several answers share the probability: {shares}.")
        return [*said, f"Chains: {self.diagnostics}."]

    def to_arviz(self) -> Any:
        """The chains as `arviz.InferenceData`: one chain a walker, one variable an unknown.

        Raises
        ------
        MissingExtraError
            If arviz is not installed.
        """
        try:
            import arviz
        except ImportError:
            raise MissingExtraError("arviz", "arviz", "Handing chains to arviz") from None
        assert self.chains is not None
        assert self.log_density is not None
        by_name = {name: self.chains[:, :, n].T.copy() for n, name in enumerate(self.draws.names)}
        return arviz.from_dict(posterior=by_name, sample_stats={"lp": self.log_density.T.copy()})


@dataclass(frozen=True)
class Posterior:
    """Posterior by emcee.

    Parameters
    ----------
    effective : float, samples wanted of the component with the fewest
    most : simulations at most
    walkers : how many; as many as the unknowns need if not given

    Raises
    ------
    InputError
        If one of them is not positive, or there are fewer walkers than twice the unknowns.
    MissingExtraError
        If emcee is not installed.
    """

    effective: float = 400.0  # Vehtari et al. (2021), section 4: enough for quantiles of 95 %
    most: int = 200_000
    walkers: int | None = None
    name: str = "posterior"

    def __post_init__(self) -> None:
        if not self.effective > 0.0:
            raise InputError(f"effective must be above 0 samples, received {self.effective:g}.")
        if self.most < 1:
            raise InputError(f"most must be at least 1 simulation, received {self.most}.")
        try:
            import emcee  # noqa: F401
        except ImportError:
            raise MissingExtraError("emcee", "posterior", "Sampling the posterior") from None

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """Sample until the chains have converged or the limit is reached; Ctrl-C ends it early."""
        joint, problem = question.joint, question.joint.problem
        sampler, interrupted = sampled(joint, self, seed, report)
        burn_in = int(_BURN_IN * sampler.iteration)
        even = sampler.get_chain(discard=burn_in)
        z = joint.to_chart(even.reshape(-1, even.shape[2]))
        values = problem.chart.to_values(z)
        diagnostics = _diagnosed(joint, sampler, self.effective)
        rng = np.random.default_rng(seed)
        chosen = np.sort(rng.permutation(len(values))[:8000])
        drawn = Draws(
            problem.names,
            _with_scatter(joint, values[chosen], rng),
            {one.name: one.direction_of for one in problem.unknowns if one.direction_of},
        )
        shares = np.bincount(joint.nearest(z), minlength=len(joint.peaks)) / len(z)
        sets = FaultSets.of_draws(problem.unknowns, drawn.values) or question.sets
        return PosteriorUncertainty(
            self.name, _intervals(question, drawn), **by_sets(question, sets, drawn),
            doubts=(
                *_unfinished(diagnostics, interrupted), *strained(question),
                *uninformed(question, drawn),
            ),
            diagnostics=diagnostics, valleys=tuple(shares.tolist()),
            chains=values.reshape(even.shape), log_density=sampler.get_log_prob(discard=burn_in),
        )  # fmt: skip


def sampled(joint: Joint, method: Posterior, seed: int, report: Report) -> tuple[Any, bool]:
    """The ensemble of emcee after its run, and whether Ctrl-C ended it.

    Raises
    ------
    InputError
        If there are too few walkers.
    """
    from emcee import EnsembleSampler, State, moves

    size = len(joint.problem.names)
    count = method.walkers or _LANES * -(-max(_LEAST_WALKERS, int(2.5 * size)) // _LANES)
    if count < 2 * size or count % 2:
        raise InputError(
            f"An ensemble needs an even number of walkers, at least twice the {size} unknowns; "
            f"received {count}."
        )
    rng = np.random.RandomState(seed)  # emcee takes no generator
    # no snooker: that of emcee 3.1.6 scales its steps by a distance that it changes, without making
    # up for it, and does not leave the weights of two minima as they are
    mixed = [(moves.DEMove(), 0.8), (moves.DEMove(gamma0=1.0), 0.05)]
    if len(joint.peaks) > 1:
        mixed.append((moves.MHMove(Jump(joint)), 0.15))
    sampler = EnsembleSampler(count, size, joint.log_density, moves=mixed, vectorize=True)
    state = State(_starts(joint, count, rng), random_state=rng.get_state())
    most, steps, interrupted = max(2, method.most // count), _FIRST, False
    with noting_interrupts() as interrupts:
        try:
            while sampler.iteration < most:
                more = min(steps, most) - sampler.iteration
                for now in sampler.sample(state, iterations=more, skip_initial_state_check=True):
                    last = now
                    interrupts.check()
                    report(count * sampler.iteration, method.most)
                state = last
                if _diagnosed(joint, sampler, method.effective).converged:
                    break
                steps = int(_GROWTH * steps)
        except KeyboardInterrupt:
            if sampler.iteration < 2:
                raise
            interrupted = True
    return sampler, interrupted


class Jump:
    """Proposal from one minimum to another, at the same distance in standard deviations.

    As `emcee.moves.MHMove` takes it. Differential evolution alone changes minima too rarely: the
    weight of two in nine unknowns was not known after 200,000 simulations, here after 50,000.
    """

    def __init__(self, joint: Joint) -> None:
        self.joint = joint
        self.places = np.array([one.z for one in joint.normals])
        self.roots = np.linalg.cholesky([one.covariance for one in joint.normals])
        self.sizes = np.log(np.diagonal(self.roots, axis1=1, axis2=2)).sum(axis=1)

    def __call__(self, even: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        """New walkers (W, d), and logarithms (W,) of the ratio of the proposals' densities."""
        z, count = self.joint.to_chart(even), len(self.places)
        # each walker for itself: walkers that choose alike are not worth as many
        here = rng.randint(count, size=len(z))
        there = (here + 1 + rng.randint(count - 1, size=len(z))) % count
        away = np.linalg.solve(self.roots[here], (z - self.places[here])[:, :, None])
        moved = self.places[there] + (self.roots[there] @ away)[:, :, 0]
        # an area of the chart is 1/r of one of even coordinates
        ratio = self.sizes[there] - self.sizes[here]
        ratio += self.joint.log_radii(z) - self.joint.log_radii(moved)
        return self.joint.to_even(moved), ratio


def _starts(joint: Joint, count: int, rng: Any) -> np.ndarray:
    """(W, d) even coordinates around all maxima, in the order of these: draws of Laplace's widths.

    Draws that are far less likely than their maximum are moved towards it.
    """
    chart, found = joint.problem.chart, []
    shares = np.array_split(np.arange(count), len(joint.peaks))
    for one, places in zip(joint.normals, shares, strict=True):
        values, vectors = eigen(one.covariance)
        away = rng.standard_normal((len(places), len(one.z))) * np.sqrt(np.maximum(values, 0.0))
        z = chart.project(one.z + away @ vectors.T)
        size = len(one.z)
        likely = 0.5 * (size + _TOO_FAR * np.sqrt(2.0 * size))
        least = joint.log_density(joint.to_even(one.z[None])) - likely
        for _ in range(8):  # halvings of the distance to the maximum
            far = joint.log_density(joint.to_even(z)) < least
            if not far.any():
                break
            z[far] = 0.5 * (z[far] + one.z)
        found.append(joint.to_even(z))
    return np.concatenate(found)


def _diagnosed(joint: Joint, sampler: Any, wanted: float) -> Diagnostics:
    """Diagnostics of the steps after burn-in, in even coordinates and of the share of minima."""
    chains = sampler.get_chain(discard=int(_BURN_IN * sampler.iteration))
    names = list(joint.problem.chart.names)
    if len(joint.peaks) > 1:  # how often walkers change between minima decides their weights
        nearest = joint.nearest(joint.to_chart(chains.reshape(-1, len(names))))
        others = range(1, len(joint.peaks))
        within = [(nearest == n).reshape(*chains.shape[:2], 1) for n in others]
        chains = np.concatenate([chains, *within], axis=2)
        names += [f"minimum {n + 1}" for n in others]
    steps, walkers, _ = chains.shape
    tau = autocorrelation_times(chains).tolist()
    return Diagnostics(
        rhat=dict(zip(names, split_rhat(chains).tolist(), strict=True)),
        tau=dict(zip(names, tau, strict=True)),
        effective={name: steps * walkers / time for name, time in zip(names, tau, strict=True)},
        steps=steps, walkers=walkers, evaluations=walkers * sampler.iteration,
        acceptance=float(sampler.acceptance_fraction.mean()), wanted=wanted,
    )  # fmt: skip


def autocorrelation_times(chains: np.ndarray) -> np.ndarray:
    """Steps (d,) between independent draws of chains (T, W, d)."""
    from emcee.autocorr import integrated_time

    with np.errstate(invalid="ignore"):
        tau = np.maximum(integrated_time(chains, tol=0, quiet=True), 1.0)
    tau = np.where(np.isfinite(tau), tau, float(len(chains)))
    return np.where(np.ptp(chains, axis=(0, 1)) > 0.0, tau, 1.0)  # a minimum where nobody is


def split_rhat(chains: np.ndarray) -> np.ndarray:
    """R-hat (d,) of chains (T, W, d): of groups of neighbours, their early and late halves."""
    steps, walkers, size = chains.shape
    groups = min(GROUPS, walkers)
    half, many = steps // 2, walkers // groups
    parts = np.array([
        chains[start : start + half, group * many : (group + 1) * many].reshape(-1, size)
        for group in range(groups)
        for start in (0, steps - half)
    ])  # fmt: skip
    within, between = parts.var(axis=1, ddof=1).mean(axis=0), parts.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(between > 0.0, np.sqrt(1.0 + between / within), 1.0)


def _intervals(question: Question, drawn: Draws) -> dict[str, tuple[float, float]]:
    """Intervals of draws; with a margin where bounds of other faults end them."""
    sharp, cornered = question.assessed.sharp_errors, set()
    for one in question.faults:
        low, high = np.quantile(drawn.of(one.name), [0.05, 0.95])
        if min(low - one.lower, one.upper - high) < sharp[one.name]:
            cornered.add(one.name)
    found = {}
    for one in question.joint.problem.unknowns:
        found[one.name] = drawn.interval(one.name, one.lower, one.upper)
        if one.name in sharp and cornered - {one.name}:
            found[one.name] = with_corner(found[one.name], sharp[one.name], one)
    return found


def _with_scatter(joint: Joint, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Values (N, d) with the scatter that the density lacks, within the bounds."""
    values = values.copy()
    for n, one in enumerate(joint.problem.unknowns):
        if one.name in joint.scatter:
            moved = values[:, n] + joint.scatter[one.name] * rng.standard_normal(len(values))
            # at a bound as far inside as it would be outside
            moved = one.lower + np.abs(moved - one.lower)
            moved = one.upper - np.abs(one.upper - moved)
            values[:, n] = np.clip(moved, one.lower, one.upper)
    return values


def _unfinished(found: Diagnostics, interrupted: bool) -> list[str]:
    """Doubt about chains that have not converged."""
    if found.converged:
        return []
    name, largest = found.largest_rhat
    why = "was interrupted" if interrupted else "reached its limit"
    return [
        f"The chains have not converged: sampling {why} after {found.evaluations} simulations, "
        f"with {found.effective[found.worst]:.0f} effective samples of {found.worst} and R-hat "
        f"{largest:.2f} of {name}. Do not rely on these intervals and probabilities; allow more "
        "simulations, or use the profile."
    ]
