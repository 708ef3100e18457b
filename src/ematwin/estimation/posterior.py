"""Posterior: draws of everything that is unknown, by an ensemble of walkers.

emcee (Foreman-Mackey et al. 2013, Publ. Astron. Soc. Pac. 125, 306-312) moves all walkers as one
batch of the lanes. A quarter of the moves are its differential evolution (ter Braak 2006, Stat.
Comput. 16, 239-249), which needs no knowledge of the density; the others know its valleys
(`ematwin.estimation.moves`) and need a tenth of the simulations where these are nearly normal.
Walkers set out from all valleys that the search found.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ematwin.errors import InputError, MissingExtraError
from ematwin.estimation.assess import with_corner
from ematwin.estimation.chains import Diagnostics, diagnosed
from ematwin.estimation.interrupt import noting_interrupts
from ematwin.estimation.intervals import Draws
from ematwin.estimation.joint import Joint
from ematwin.estimation.moves import Jump, Surrogate, walked
from ematwin.estimation.uncertainty import (
    Question,
    Report,
    Uncertainty,
    strained,
    told,
    uninformed,
)

EFFECTIVE = 400.0  # Vehtari et al. (2021), section 4: enough for quantiles of 95 %
MOST = 200_000  # simulations
_LEAST_WALKERS, _LANES = 64, 32
_FIRST, _GROWTH = 150, 1.5  # steps until chains are looked at, and how many times more then
_SETTLING = 1.0 / 3.0  # share of the steps that is left out
_KEPT = 8000  # draws
_BESIDE = 1e-2  # standard errors
_HALVINGS = 8  # of the way to the peak, for walkers that set out too far away
_TOO_FAR = 4.0  # standard deviations of a chi-squared distribution


@dataclass(frozen=True)
class PosteriorUncertainty(Uncertainty):
    """Draws of a posterior, with what is known of the chains that they come from.

    Attributes
    ----------
    diagnostics : of the chains
    valleys : probability of each valley that the search found, the best fit first
    chains : (T, W, d) values along the walkers, in the order of ``draws.names``
    log_density : (T, W)
    """

    diagnostics: Diagnostics | None = None
    valleys: tuple[float, ...] = ()
    chains: np.ndarray | None = None
    log_density: np.ndarray | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        told = super().as_dict()
        assert self.diagnostics is not None
        return {
            **told, "valleys": list(self.valleys), "diagnostics": self.diagnostics.as_dict()
        }  # fmt: skip

    @property
    def sentences(self) -> list[str]:
        """What it says beside the intervals, the diagnostics last."""
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
        assert self.draws is not None
        assert self.chains is not None
        assert self.log_density is not None
        by_name = {name: self.chains[:, :, n].T.copy() for n, name in enumerate(self.draws.names)}
        return arviz.from_dict(posterior=by_name, sample_stats={"lp": self.log_density.T.copy()})


@dataclass(frozen=True)
class Posterior:
    """The posterior by emcee.

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

    effective: float = EFFECTIVE
    most: int = MOST
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
        """Sample until the chains have arrived, or the limit is reached; Ctrl-C ends it early."""
        chains = sampled(
            question.joint, effective=self.effective, most=self.most, walkers=self.walkers,
            seed=seed, report=report,
        )  # fmt: skip
        return _answer(question, chains, seed, self.name)


@dataclass(frozen=True)
class Chains:
    """Walkers on their way through a joint density.

    Attributes
    ----------
    z : (T, W, d) array, coordinates of the chart
    log_density : (T, W) array
    diagnostics : Diagnostics
    stopped : "converged", "limit" or "interrupted"
    """

    z: np.ndarray
    log_density: np.ndarray
    diagnostics: Diagnostics
    stopped: str


def sampled(
    joint: Joint,
    *,
    effective: float = EFFECTIVE,
    most: int = MOST,
    walkers: int | None = None,
    seed: int = 1,
    report: Report = lambda spent, most: None,
) -> Chains:
    """Chains of a joint density; arguments as of `Posterior`."""
    import emcee

    size = len(joint.problem.names)
    count = walkers or _LANES * -(-max(_LEAST_WALKERS, int(2.5 * size)) // _LANES)
    if count < 2 * size or count % 2:
        raise InputError(
            f"An ensemble needs an even number of walkers, at least twice the {size} unknowns; "
            f"received {count}."
        )
    rng = np.random.RandomState(seed)  # emcee takes no generator
    counted = _Counted(joint)
    names = (
        *joint.problem.chart.names,
        *(f"valley {n + 1}" for n in range(1, len(joint.valleys))),
    )

    def looked_at() -> Chains:
        gone = int(_SETTLING * sampler.iteration)
        even = sampler.get_chain(discard=gone)
        z = joint.to_chart(even.reshape(-1, size))
        told = even
        if len(joint.valleys) > 1:  # how often walkers change their valleys decides the weights
            within = [_nearest(joint, z) == n for n in range(1, len(joint.valleys))]
            told = np.concatenate([even, *(w.reshape(*even.shape[:2], 1) for w in within)], axis=2)
        found = diagnosed(
            told, names, evaluations=counted.spent, wanted=effective,
            acceptance=float(sampler.acceptance_fraction.mean()),
        )  # fmt: skip
        return Chains(z.reshape(even.shape), sampler.get_log_prob(discard=gone), found, "limit")

    sampler = emcee.EnsembleSampler(count, size, counted, moves=_moves(joint), vectorize=True)
    stopped, steps = "limit", _FIRST
    with noting_interrupts() as interrupts:
        try:
            first = _starts(joint, counted, count, rng)
            state = emcee.State(first, random_state=rng.get_state())
            while True:
                rest = steps - sampler.iteration
                for moved in sampler.sample(state, iterations=rest, skip_initial_state_check=True):
                    state_now = moved
                    interrupts.check()
                    report(counted.spent, most)
                    if counted.spent >= most:
                        break
                state = state_now
                chains = looked_at()
                if chains.diagnostics.converged or counted.spent >= most:
                    stopped = "converged" if chains.diagnostics.converged else "limit"
                    break
                steps = int(_GROWTH * steps)
        except KeyboardInterrupt:
            if sampler.iteration < 2:
                raise
            stopped, chains = "interrupted", looked_at()
    return replace(chains, stopped=stopped)


class _Counted:
    """The log density of even coordinates, and how many were asked for."""

    def __init__(self, joint: Joint) -> None:
        self.joint, self.spent = joint, 0

    def __call__(self, even: np.ndarray) -> np.ndarray:
        self.spent += len(even)
        return self.joint.log_density(even)


def _moves(joint: Joint) -> list[tuple[Any, float]]:
    """Moves with their shares; the map between valleys only where there are several."""
    from emcee import moves

    jump = 0.15 if len(joint.valleys) > 1 else 0.0
    own = [(moves.MHMove(Surrogate(joint)), 0.75 - jump)]
    if jump:
        own.append((moves.MHMove(Jump(joint)), jump))
    # no snooker: that of emcee 3.1.6 scales its steps by a distance that it changes, without making
    # up for it, and does not leave the weights of two valleys as they are
    return [*own, (moves.DEMove(), 0.2), (moves.DEMove(gamma0=1.0), 0.05)]


def _starts(joint: Joint, counted: _Counted, count: int, rng: Any) -> np.ndarray:
    """(W, d) even coordinates, spread over all valleys, each by its width."""
    share = np.array_split(np.arange(count), len(joint.valleys))
    found = []
    for valley, places in zip(joint.valleys, share, strict=True):
        # off the middle of a vector, which no step leaves
        first = np.repeat(valley.z[None], len(places), axis=0)
        beside = np.sqrt(np.diag(valley.covariance)) * rng.standard_normal(first.shape)
        first = joint.problem.chart.project(first + _BESIDE * np.minimum(beside, 1.0))
        z = walked(joint, valley, first, 10 * len(valley.z), rng)
        size = len(valley.z)
        least = float(counted(joint.to_even(valley.z[None]))[0])
        limit = least - 0.5 * (size + _TOO_FAR * np.sqrt(2.0 * size))
        for _ in range(_HALVINGS):
            far = counted(joint.to_even(z)) < limit
            if not far.any():
                break
            z[far] = 0.5 * (z[far] + valley.z)
        found.append(joint.to_even(z))
    return np.concatenate(found)


def _answer(question: Question, chains: Chains, seed: int, method: str) -> PosteriorUncertainty:
    joint, problem = question.joint, question.joint.problem
    steps, walkers, size = chains.z.shape
    values = problem.chart.to_values(chains.z.reshape(-1, size))
    rng = np.random.default_rng(seed)
    chosen = np.sort(rng.permutation(len(values))[:_KEPT])
    drawn = Draws(
        problem.names,
        _with_scatter(joint, values[chosen], rng),
        {one.name: one.direction_of for one in problem.unknowns if one.direction_of},
    )
    cornered = _at_bounds(question, drawn)
    intervals = {}
    for one in problem.unknowns:
        ends = drawn.interval(one.name, one.lower, one.upper)
        if one.name in question.assessed.sharp_errors and cornered - {one.name}:
            ends = with_corner(ends, question.assessed.sharp_errors[one.name], one)
        intervals[one.name] = ends
    nearest = _nearest(joint, chains.z.reshape(-1, size))
    shares = np.bincount(nearest, minlength=len(joint.valleys)) / len(nearest)
    return PosteriorUncertainty(
        method, intervals, **told(question, drawn),
        doubts=(*_unfinished(chains), *strained(question), *uninformed(question, drawn)),
        diagnostics=chains.diagnostics, valleys=tuple(shares.tolist()),
        chains=values.reshape(steps, walkers, size), log_density=chains.log_density,
    )  # fmt: skip


def _at_bounds(question: Question, drawn: Draws) -> set[str]:
    """Names of faults of which draws reach a bound: the truth may lie in a corner of them."""
    found = set()
    for one in question.faults:
        low, high = np.quantile(drawn.of(one.name), [0.05, 0.95])
        reach = question.assessed.sharp_errors[one.name]
        if low - one.lower < reach or one.upper - high < reach:
            found.add(one.name)
    return found


def _with_scatter(joint: Joint, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Values (N, d) with what healthy recordings differed by, within the bounds."""
    values = values.copy()
    for n, one in enumerate(joint.problem.unknowns):
        if one.name in joint.scatter:
            moved = values[:, n] + joint.scatter[one.name] * rng.standard_normal(len(values))
            # at a bound as far inside as it would be outside
            moved = one.lower + np.abs(moved - one.lower)
            moved = one.upper - np.abs(one.upper - moved)
            values[:, n] = np.clip(moved, one.lower, one.upper)
    return values


def _nearest(joint: Joint, z: np.ndarray) -> np.ndarray:
    """The valley (N,) to which points z (N, d) are nearest, in its standard deviations."""
    return np.argmax([one.log_density(z) for one in joint.valleys], axis=0)


def _unfinished(chains: Chains) -> Sequence[str]:
    """That chains have not arrived, if so."""
    found = chains.diagnostics
    if found.converged:
        return []
    name, largest = found.largest_rhat
    why = "was interrupted" if chains.stopped == "interrupted" else "reached its limit"
    return [
        f"The chains have not converged: sampling {why} after {found.evaluations} simulations, "
        f"with {found.effective[found.worst]:.0f} effective samples of {found.worst} and R-hat "
        f"{largest:.2f} of {name}. Do not rely on these intervals and probabilities; allow more "
        "simulations, or use the profile."
    ]
