"""Nominal parameters of an actuator from its healthy motions.

Least squares on the mean motions of the runs. The load of each is unknown and fitted with it.
Parameters are fitted as logarithms around the template, whose values count as a weak prior; where
the recordings narrow a parameter by less than half, they have not determined it, and that is said.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ematwin.monitoring.estimate import Weights, estimate, first_prior, first_starts
from ematwin.monitoring.twin import twin_traces
from ematwin.plant.ball_screw import BallScrew

# What a recording of current and position error can say something of, and how far (as a factor,
# one standard deviation) the template may be off.
FITTED = {
    "screw.friction_force": 2.0,
    "screw.fading_speed": 1.5,
    "screw.efficiency_opposing": 1.3,
    "screw.efficiency_aiding": 1.1,
    "drive.idle_current": 2.0,
    "drive.response_time": 2.0,
    "controller.position_gain": 1.5,
    "controller.integral_gain": 1.5,
}
FIRST_WEIGHTS = Weights(0.05, 2e-4)
_DETERMINED = 0.5  # of the prior's standard deviation
_LIMITS = {"screw.efficiency_opposing": 1.0, "screw.efficiency_aiding": 1.0}


@dataclass(frozen=True)
class NominalParameter:
    """One fitted parameter.

    Attributes
    ----------
    place : e.g. "screw.friction_force"
    value, template : SI units
    standard_error : SI units; of the fit to the mean motions, which says nothing of other runs
    determined : whether the recordings say more of it than the template does
    """

    place: str
    value: float
    template: float
    standard_error: float
    determined: bool


@dataclass(frozen=True)
class MeanMotion:
    """The mean of the motions of a run under one condition: currents and errors, (S,) arrays."""

    current: np.ndarray  # A
    position_error: np.ndarray  # m


def fit_nominal(
    template: BallScrew, set_point: np.ndarray, interval: float, means: list[MeanMotion]
) -> tuple[BallScrew, list[NominalParameter]]:
    """The actuator that answers as the healthy ones did on the average, and what was fitted.

    What turns out not to be determined goes back to the template's value, and the rest is fitted
    again.

    Parameters
    ----------
    template : BallScrew
    set_point : (S,) array, m, common to all
    interval : float, s
    means : one for each run and condition
    """
    fit = _Fit(template, set_point, interval, means)
    values, errors = fit.run(list(FITTED))
    vague = [place for place in FITTED if errors[place] >= _DETERMINED * np.log(FITTED[place])]
    if vague:
        values, again = fit.run([place for place in FITTED if place not in vague])
        errors |= again
    parameters = []
    for place in FITTED:
        start = _value(template, place)
        value = values.get(place, start)
        parameters.append(
            NominalParameter(place, value, start, errors[place] * value, place not in vague)
        )
    return _with(template, values), parameters


class _Fit:
    """Least squares on mean motions; the load and the initial error of each are fitted with it."""

    def __init__(
        self, template: BallScrew, set_point: np.ndarray, interval: float, means: list[MeanMotion]
    ) -> None:
        self._template, self._set_point, self._interval = template, set_point, interval
        self._count = len(means)
        self._unit = 0.1 * template.screw.friction_force  # N, scale of the loads
        own = np.array([_start_of(template, set_point, interval, mean) for mean in means])
        self._first = (own / [self._unit, 1e-3]).ravel()
        self._measured = np.stack([_weighed(m.current, m.position_error) for m in means])

    def run(self, places: list[str]) -> tuple[dict[str, float], dict[str, float]]:
        """Values of these parameters, and standard errors of their logarithms."""
        start = np.array([_value(self._template, place) for place in places])
        spread = np.log(np.array([FITTED[place] for place in places]))
        upper = np.log(np.array([_LIMITS.get(place, np.inf) for place in places]) / start)
        count = len(places)

        def residuals(x: np.ndarray) -> np.ndarray:
            values = dict(zip(places, start * np.exp(x[:count]), strict=True))
            missed = self._answers(values, x[count:].reshape(-1, 2)) - self._measured
            return np.r_[missed.ravel(), x[:count] / spread]

        high = np.r_[upper, np.full(2 * self._count, np.inf)]
        first = np.minimum(np.r_[np.zeros(count), self._first], high - 1e-9)
        found = least_squares(
            residuals, first, bounds=(-np.inf, high), diff_step=1e-4, loss="soft_l1", max_nfev=60
        )
        # neighbouring samples miss alike: what the twin misses counts as noise of the data
        inflation = max(1.0, 2.0 * found.cost / max(1, self._measured.size - found.x.size))
        of_data = found.jac[:-count]
        information = of_data.T @ of_data / inflation
        information[np.arange(count), np.arange(count)] += 1.0 / spread**2
        errors = np.sqrt(np.diag(np.linalg.inv(information))[:count])
        values = start * np.exp(found.x[:count])
        return (
            dict(zip(places, values.tolist(), strict=True)),
            dict(zip(places, errors.tolist(), strict=True)),
        )

    def _answers(self, values: dict[str, float], own: np.ndarray) -> np.ndarray:
        """What the twin answers, (runs, 2 S), in standard deviations."""
        actuator = _with(self._template, values)
        one = np.ones(self._count)
        magnitudes = np.column_stack(
            [one, actuator.screw.backlash * one, one, own[:, 0] * self._unit, own[:, 1] * 1e-3]
        )
        return _weighed(*twin_traces(actuator, self._set_point, self._interval, magnitudes))


def _weighed(current: np.ndarray, position_error: np.ndarray) -> np.ndarray:
    return np.concatenate(
        [current / FIRST_WEIGHTS.current, position_error / FIRST_WEIGHTS.position_error], axis=-1
    )


def _start_of(
    template: BallScrew, set_point: np.ndarray, interval: float, mean: MeanMotion
) -> tuple[float, float]:
    """Load and initial error from which the common fit starts."""
    magnitudes, _ = estimate(
        template, set_point, interval, mean.current, mean.position_error, FIRST_WEIGHTS,
        first_prior(template), first_starts(template, mean.position_error[0]),
    )  # fmt: skip
    return float(magnitudes[3]), float(magnitudes[4])


def _value(actuator: BallScrew, place: str) -> float:
    section, name = place.split(".")
    return float(getattr(getattr(actuator, section), name))


def _with(actuator: BallScrew, values: dict[str, float]) -> BallScrew:
    """Without validation, which a thousand calls of a fit need not repeat."""
    sections: dict[str, dict[str, float]] = {}
    for place, value in values.items():
        section, name = place.split(".")
        sections.setdefault(section, {})[name] = float(value)
    return actuator.model_copy(
        update={key: getattr(actuator, key).model_copy(update=v) for key, v in sections.items()}
    )
