"""Nominal parameters of an actuator from its healthy motions.

Least squares on the mean motions of the runs. The load of each is unknown and fitted with it.
Parameters are fitted as logarithms around the template, whose values count as a weak prior; where
the recordings narrow a parameter by less than half, they have not determined it, and that is said.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ematwin.monitoring.estimate import Weights, estimate, first_prior
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

    Parameters
    ----------
    template : BallScrew
    set_point : (S,) array, m, common to all
    interval : float, s
    means : one for each run and condition
    """
    places = list(FITTED)
    start = np.array([_value(template, place) for place in places])
    spread = np.log(np.array([FITTED[place] for place in places]))
    loads = np.array([_start_of(template, set_point, interval, mean) for mean in means])
    upper = np.array(
        [np.log(_LIMITS.get(place, np.inf) / s) for place, s in zip(places, start, strict=True)]
    )
    unit = 0.1 * template.screw.friction_force  # N, scale of the loads
    count = len(places)
    measured = np.stack(
        [
            np.r_[
                mean.current / FIRST_WEIGHTS.current,
                mean.position_error / FIRST_WEIGHTS.position_error,
            ]
            for mean in means
        ]
    )

    def residuals(x: np.ndarray) -> np.ndarray:
        actuator = _with(template, places, start * np.exp(x[:count]))
        own = x[count:].reshape(-1, 2)
        magnitudes = np.column_stack([
            np.ones(len(means)), np.full(len(means), actuator.screw.backlash),
            np.ones(len(means)), own[:, 0] * unit, own[:, 1] * 1e-3,
        ])  # fmt: skip
        i, e = twin_traces(actuator, set_point, interval, magnitudes)
        answer = np.concatenate(
            [i / FIRST_WEIGHTS.current, e / FIRST_WEIGHTS.position_error], axis=1
        )
        return np.r_[(answer - measured).ravel(), x[:count] / spread]

    first = np.r_[np.minimum(0.0, upper), (loads / [unit, 1e-3]).ravel()]
    high = np.r_[upper, np.full(2 * len(means), np.inf)]
    found = least_squares(
        residuals, np.minimum(first, high - 1e-9), bounds=(-np.inf, high), diff_step=1e-4,
        loss="soft_l1", max_nfev=60,
    )  # fmt: skip
    fitted = start * np.exp(found.x[:count])
    # residuals of neighbouring samples are alike: as many independent ones as the twin misses
    inflation = max(1.0, 2.0 * found.cost / max(1, measured.size - found.x.size))
    information = found.jac.T @ found.jac / inflation
    information[np.arange(count), np.arange(count)] += 1.0 / spread**2
    errors = np.sqrt(np.diag(np.linalg.inv(information))[:count])
    parameters = [
        NominalParameter(
            place, float(fitted[n]), float(start[n]), float(errors[n] * fitted[n]),
            bool(errors[n] < _DETERMINED * spread[n]),
        )
        for n, place in enumerate(places)
    ]  # fmt: skip
    return _with(template, places, fitted), parameters


def _start_of(
    template: BallScrew, set_point: np.ndarray, interval: float, mean: MeanMotion
) -> tuple[float, float]:
    """Load and initial error from which the common fit starts."""
    prior = first_prior(template)
    pull = 0.1 * template.screw.friction_force
    starts = np.tile(prior.mean, (2, 1))
    starts[:, 3] = (-pull, pull)
    starts[:, 4] = mean.position_error[0]
    magnitudes, _ = estimate(
        template, set_point, interval, mean.current, mean.position_error, FIRST_WEIGHTS, prior,
        starts,
    )  # fmt: skip
    return float(magnitudes[3]), float(magnitudes[4])


def _value(actuator: BallScrew, place: str) -> float:
    section, name = place.split(".")
    return float(getattr(getattr(actuator, section), name))


def _with(actuator: BallScrew, places: list[str], values: np.ndarray) -> BallScrew:
    """Without validation, which a thousand calls of a fit need not repeat."""
    sections: dict[str, dict[str, float]] = {}
    for place, value in zip(places, values, strict=True):
        section, name = place.split(".")
        sections.setdefault(section, {})[name] = float(value)
    return actuator.model_copy(
        update={key: getattr(actuator, key).model_copy(update=v) for key, v in sections.items()}
    )
