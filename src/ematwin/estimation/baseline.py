"""Baseline: the prior knowledge of an actuator before a recording is judged.

The values of its parameters with their joint uncertainty, how well the twin explains it while it is
healthy, and what may have drifted since. Without calibration the uncertainty comes from a data
sheet: the tolerances of the parameter file, or the defaults of the kind.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ematwin.estimation.constants import DETERMINED, SEARCHED, TWO_SIGMA
from ematwin.estimation.prior import Prior
from ematwin.estimation.problem import Problem
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import model_of
from ematwin.models.unknown import Unknown
from ematwin.validation import damage_said, load_toml, refuse_newer

FORMAT = 1
ANEW = "Make it anew with ematwin calibrate."  # what to do with a damaged calibration

_TERMS = ("N", "N*m", "kg", "kg*m^2", "N*s/m", "N*m*s/rad")  # of a balance of forces or torques


@dataclass(frozen=True)
class NominalParameter:
    """One fitted parameter, SI units."""

    place: str  # e.g. "screw.friction_force"
    value: float
    template: float
    standard_error: float
    determined: bool  # the recordings say more of it than the template does


class ClosedLoop(NamedTuple):
    """What healthy recordings show in closed loop; fields as of `Baseline`."""

    misfit: float
    scatter: Mapping[str, float]


@dataclass(frozen=True)
class Baseline:
    """Prior knowledge of an actuator."""

    prior: Prior  # of its parameters, and of nuisances where healthy recordings tell them
    misfit: float = math.nan  # relative, what healthy recordings left; NaN if there were none
    expected_misfit: float = math.nan  # what noise and the twin's known error alone leave
    # by fault, how far healthy recordings are found off healthy
    scatter: Mapping[str, float] = field(default_factory=dict)
    # by channel, the most that a healthy recording left, in the unit of `Model.noise`
    left: Mapping[str, float] = field(default_factory=dict)
    recordings: int = 0  # how many healthy ones
    has_load: bool = True  # they held the load
    exact: bool = False  # parameters, load and sensors are exactly as given, as in a simulation
    known: frozenset[str] = frozenset()  # as good as exactly, and without drift
    forms: str = ""  # on those that healthy recordings show and the file had left out
    absent_forms: tuple[str, ...] = ()  # names of those that explain nothing
    # of recordings that the closed loop judges, where equations along the motion give the rest
    closed_loop: "ClosedLoop | None" = None

    @property
    def calibrated(self) -> bool:
        """Whether it rests on recordings of this actuator, or nothing is left to learn."""
        return self.recordings > 0 or self.exact

    @classmethod
    def of_simulation(cls) -> "Baseline":
        """The baseline of an actuator that is known exactly."""
        return cls(Prior.independent([]), exact=True)

    @classmethod
    def of_template(cls, model: Model, actuator: ParameterSet) -> "Baseline":
        """The baseline of an actuator with a parameter file only."""
        return cls(Prior.independent(uncertain(model, actuator)))

    def knowing(self, unknowns: Iterable[Unknown]) -> "Baseline":
        """The same, with some parameters, load or sensors known as good as exactly."""
        if self.exact:
            return self
        chosen = list(unknowns)
        prior = with_nuisances(self.prior, (o for o in chosen if o.spread is not None))
        names = {one.name for one in chosen}
        tight = np.array([1e-3 if name in names else 1.0 for name in prior.names])
        return replace(
            self,
            prior=replace(prior, covariance=prior.covariance * np.outer(tight, tight)),
            known=self.known | names,
        )

    def drifted(self, actuator: ParameterSet) -> Prior:
        """The prior of a later recording: parameters may have drifted since."""
        covariance = self.prior.covariance.copy()
        for n, name in enumerate(self.prior.names):
            drifts = "." in name and name not in self.known
            drift = actuator.drift(name) if drifts else None
            if drift is not None and self.calibrated:
                covariance[n, n] += (math.log1p(drift) / TWO_SIGMA) ** 2
        return Prior(self.prior.names, self.prior.mean, covariance)

    def as_table(self) -> dict[str, Any]:
        """Plain values, for a TOML file."""
        numbers = {"misfit": self.misfit, "expected_misfit": self.expected_misfit}
        return {
            "format": FORMAT,
            "names": list(self.prior.names),
            "mean": self.prior.mean.tolist(),
            "covariance": self.prior.covariance.tolist(),
            "scatter": dict(self.scatter),
            "left": dict(self.left),
            "recordings": self.recordings,
            "has_load": self.has_load,
            "forms": self.forms,
            "absent_forms": list(self.absent_forms),
            **{name: value for name, value in numbers.items() if math.isfinite(value)},
            **({} if self.closed_loop is None else {"closed_loop": self.closed_loop._asdict()}),
        }

    @classmethod
    def from_table(cls, table: Any, what: str) -> "Baseline":
        """Read the result of `as_table`; `ParameterError` if damaged or of a newer ematwin."""
        what = f"The baseline of {what}"
        with damage_said(what, ANEW):
            refuse_newer(what, int(table["format"]), FORMAT)
            names = tuple(str(name) for name in table["names"])
            mean = np.array(table["mean"], dtype=float)
            covariance = np.array(table["covariance"], dtype=float)
            if mean.shape != (len(names),) or covariance.shape != (len(names), len(names)):
                raise ValueError(f"{len(names)} names, {mean.shape} and {covariance.shape}")
            if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
                raise ValueError("values that are not finite")
            if not np.allclose(covariance, covariance.T):
                raise ValueError("a covariance that is not symmetric")
            np.linalg.cholesky(covariance)
            closed = table.get("closed_loop")
            return cls(
                Prior(names, mean, covariance),
                float(table.get("misfit", math.nan)),
                float(table.get("expected_misfit", math.nan)),
                _plain_floats(table["scatter"]),
                _plain_floats(table.get("left", {})),
                int(table["recordings"]),
                bool(table["has_load"]),
                forms=str(table.get("forms", "")),
                absent_forms=tuple(map(str, table.get("absent_forms", ()))),
                closed_loop=None
                if closed is None
                else ClosedLoop(float(closed["misfit"]), _plain_floats(closed["scatter"])),
            )


def _plain_floats(table: Mapping[Any, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in table.items()}


def nominal_parameters(
    template: ParameterSet, unknowns: Iterable[Unknown], found: Prior
) -> list[NominalParameter]:
    """Fitted parameters, from their distribution."""
    errors = np.sqrt(np.diag(found.covariance)).tolist()
    known = {n: (x, s) for n, x, s in zip(found.names, found.mean.tolist(), errors, strict=True)}
    parameters = []
    for one in unknowns:
        (mean, error), assumed = known[one.name], one.spread or 0.0
        value = math.exp(mean) if one.logarithmic else mean
        told = error < DETERMINED * assumed
        error *= value if one.logarithmic else 1.0
        parameters.append(NominalParameter(one.name, value, template.value(one.name), error, told))
    return parameters


def baseline_of(given: Any, actuator: ParameterSet) -> Baseline:
    """The baseline of what `ematwin.identify` takes as an actuator.

    A calibration or its file holds its baseline; any other parameter set gives its tolerances.
    """
    held = getattr(given, "baseline", None)
    if isinstance(held, Baseline):
        return held
    if isinstance(given, str | Path) and str(given).endswith(".toml"):
        table = load_toml(Path(given), "actuator").get("baseline")
        if table is not None:
            return Baseline.from_table(table, str(given))
    return Baseline.of_template(model_of(actuator), actuator)


def frees_parameters(model: Model) -> bool:
    """Whether parameters are free beside the faults: unless a healthy population judges."""
    return model.monitoring is None


def uncertain(model: Model, actuator: ParameterSet) -> list[Unknown]:
    """Parameters that may be off, as unknowns with the spread of their tolerances.

    A kind that states no tolerance of a parameter may say how far a template may be off
    (`Model.nominal`, `Model.signed`).
    """
    found = []
    for place, value, *_ in actuator.parameters():
        tolerance = actuator.tolerance(place)
        if place in model.signed:
            found.append(model.unknown(actuator, place))
        elif (tolerance or place in model.nominal) and place not in model.fixed and value > 0.0:
            one = model.unknown(actuator, place)
            spread = one.spread if tolerance is None else math.log1p(tolerance) / TWO_SIGMA
            found.append(replace(one, spread=spread))
    return found


def searched_range(one: Unknown) -> Unknown:
    """The unknown with bounds that its prior makes likely."""
    assert one.spread is not None
    if not one.logarithmic:
        return one
    reach = math.exp(SEARCHED * one.spread)
    return replace(
        one, lower=max(one.lower, one.healthy / reach), upper=min(one.upper, one.healthy * reach)
    )


def effective(
    model: Model, actuator: ParameterSet, comparisons: Iterable[Comparison]
) -> list[Unknown]:
    """Nuisances that widen intervals and are not searched, if they matter to a comparison."""
    without = frozenset.intersection(*(one.ignores for one in comparisons))
    return [one for one in model.marginal(actuator) if one.name not in without]


def with_nuisances(prior: Prior, unknowns: Iterable[Unknown]) -> Prior:
    """The prior with the nuisances that it does not hold yet."""
    return prior.and_(Prior.independent(o for o in unknowns if o.name not in prior.names))


def later(model: Model, actuator: ParameterSet, baseline: Baseline) -> tuple[Prior, list[Unknown]]:
    """The prior of a later recording, and its unknowns.

    Where it was learnt, terms of a balance deviate by values, not by logarithms: recordings may
    tell the sum of two frictions well, and each of them badly. Along a line of their logarithms the
    sum does not stay.
    """
    prior = baseline.drifted(actuator)
    unknowns = [replace(model.unknown(actuator, name), spread=None) for name in prior.names]
    if not baseline.calibrated:
        return prior, unknowns
    terms = np.array([one.logarithmic and one.unit in _TERMS for one in unknowns], bool)
    mean = np.where(terms, np.exp(np.where(terms, prior.mean, 0.0)), prior.mean)
    scale = np.where(terms, mean, 1.0)
    prior = replace(prior, mean=mean, covariance=prior.covariance * np.outer(scale, scale))
    return prior, [
        replace(one, logarithmic=False) if term else one
        for one, term in zip(unknowns, terms, strict=True)
    ]


def with_all_free(
    model: Model,
    actuator: ParameterSet,
    problem: Problem,
    baseline: Baseline,
    judged: Problem | None = None,
) -> Problem:
    """The problem with parameters, load and sensors free within their uncertainty.

    ``judged`` replaces the comparisons of the problem, where given.
    """
    judged = judged or problem
    if baseline.exact:
        return judged
    taken = {*problem.names, *problem.held}
    prior, places = later(model, actuator, baseline)
    places = [one for one in places if one.name not in taken]
    prior = prior.of(one.name for one in places)
    comparisons = [one.with_evidence() for one in judged.comparisons]
    more = [one for one in effective(model, actuator, comparisons) if one.name not in taken]
    own = [one for one in problem.unknowns if one.spread is not None]
    prior = with_nuisances(with_nuisances(prior, own), more)
    full = Problem(comparisons, [*problem.unknowns, *places, *more], held=problem.held, prior=prior)
    return full.with_noise(judged.noise)
