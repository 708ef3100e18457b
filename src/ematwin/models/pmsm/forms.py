"""Forms that healthy recordings of a PMSM servo may show though its file has them otherwise.

The controller of such a servo is sampled and known. Cogging, harmonics of the EMF and friction that
gives before it slides are looked for in the response of the closed loops, which is smooth.
"""

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ematwin.models.optional import Equation, Form, Values
from ematwin.models.pmsm.comparison import REFERENCE_ERROR, PmsmComparison
from ematwin.models.servo import possible_coggings
from ematwin.numerics.side_by_side import side_by_side
from ematwin.numerics.signals import white_noise

_SHARE = 0.3  # of the dry friction of the motor, that cogging begins with
_HARMONIC = 0.02
_BENT = (3e-4, 6e-4, 1e-3, 2e-3, 4e-3, 8e-3)  # rad on the motor shaft, before friction slides
_PARTS = 60  # of a recording; within a part channels follow each other
_DAMPING = 0.01  # N m s/rad
_COGGING = ("motor.cogging_torque", "motor.cogging_periods", "motor.cogging_phase")
_HARMONICS = ("motor.harmonic_5", "motor.harmonic_7")
_STIFFNESS = ("presliding.motor_stiffness", "presliding.output_stiffness")


def _values(actuator: Any, places: tuple[str, ...]) -> dict[str, float]:
    return {place: actuator.value(place) for place in places}


def _coggings(actuator: Any) -> list[Values]:
    torque = max(actuator.motor.cogging_torque, _SHARE * actuator.motor.friction_torque)
    return [
        dict(zip(_COGGING, (torque, *each), strict=True))
        for each in possible_coggings(actuator.motor.pole_pairs)
    ]


def _harmonics(actuator: Any) -> list[Values]:
    now = _values(actuator, _HARMONICS)
    return [{**now, place: now[place] + x} for place in _HARMONICS for x in (-_HARMONIC, _HARMONIC)]


def _stiffness(actuator: Any) -> list[dict[str, float]]:
    """Of both sides, for each way that they give."""
    gear = actuator.transmission
    frictions = (actuator.motor.friction_torque, gear.friction_torque)
    return [
        {p: gear.static_ratio * x / bent for p, x in zip(_STIFFNESS, frictions, strict=True)}
        for bent in _BENT
    ]


def _bristles(actuator: Any) -> list[Values]:
    return [{**each, "presliding.damping": _DAMPING} for each in _stiffness(actuator)]


def _other_bristles(actuator: Any) -> list[Values]:
    """All pairs: chosen one after the other, stiffnesses may miss the best pair."""
    each, (motor, output) = _stiffness(actuator), _STIFFNESS
    return [{motor: one[motor], output: other[output]} for one in each for other in each]


def _said_of_harmonics(actuator: Any) -> str:
    fifth, seventh = (100.0 * actuator.value(place) for place in _HARMONICS)
    return f"harmonics of the back-EMF of {fifth:.2g} % (5th) and {seventh:.2g} % (7th)"


def _said_of_bristles(actuator: Any) -> str:
    bent = actuator.motor.friction_torque / actuator.presliding.motor_stiffness
    return f"friction of the motor gives {1e3 * bent:.2g} mrad before it slides"


def _forms(sheet: Any) -> tuple[Form, ...]:
    """Forms that are otherwise than in the sheet."""
    cogging, harmonics = (_values(sheet, places) for places in (_COGGING, _HARMONICS))
    return (
        Form(
            "cogging",
            lambda a: _values(a, _COGGING[1:]) != {p: cogging[p] for p in _COGGING[1:]},
            _COGGING,
            _coggings,
            lambda a: (
                f"cogging of {1e3 * a.motor.cogging_torque:.2g} mN m, "
                f"{a.motor.cogging_periods} a turn"
            ),
            ("motor.cogging_torque", "motor.cogging_phase"),
        ),
        Form(
            "harmonics of the back-EMF",
            lambda a: _values(a, _HARMONICS) != harmonics,
            _HARMONICS,
            _harmonics,
            _said_of_harmonics,
            _HARMONICS,
        ),
        Form(
            "presliding friction",
            lambda a: a.presliding is not None,
            _STIFFNESS,
            _bristles,
            _said_of_bristles,
            alternatives=_other_bristles,
        ),
    )


class Response:
    """The twin's response less the recording, in standard deviations of noise.

    The reference model reads angles and currents in steps, so that its differences are rough. The
    monitor model answers, corrected by its difference from the reference for the first actuator
    with such friction: only the reference has bristles, whose stiffness is chosen from a list.

    Attributes
    ----------
    size : float, norm of the weighted recording; 0 of one that begins in motion, where the
        integrals of the loops are not known
    """

    def __init__(self, compared: PmsmComparison) -> None:
        self._compared = compared.with_missed({})
        self._missed: dict[Any, np.ndarray] = {}
        self._channels = len(compared.measured())
        self.size = math.sqrt(self._compared.scale) if compared.before else 0.0

    def least(self, actuator: Any) -> float:
        """Share of the recording that noise and the error of the reference leave."""
        rows = self._rows([actuator])[0]
        noise = math.sqrt(sum(white_noise(row) ** 2 * row.size for row in rows))
        return math.hypot(noise / self.size, REFERENCE_ERROR)

    def left(self, actuator: Any, values: Values) -> np.ndarray:
        """Residual (K,), one part of the recording after the other."""
        return self.each([actuator])[0]

    def each(self, actuators: Sequence[Any]) -> list[np.ndarray]:
        """The same of several actuators, side by side in the lanes of the twin."""
        found = []
        for rows in self._rows(actuators):
            parts = np.array_split(rows, _PARTS, axis=1)
            found.append(np.concatenate([part.ravel() for part in parts]))
        return found

    def _rows(self, actuators: Sequence[Any]) -> np.ndarray:
        """Residual (B, C, S) of each channel; infinite where the twin diverged."""
        answers = self._compared.answers_of(actuators)
        first = {one.presliding: n for n, one in reversed(list(enumerate(actuators)))}
        new = {key: n for key, n in first.items() if key not in self._missed}
        exact = side_by_side(lambda n: self._exact(actuators[n]), new.values())
        for (key, n), answer in zip(new.items(), exact, strict=True):
            self._missed[key] = answer - answers[n]
        answers += np.array([self._missed[one.presliding] for one in actuators])
        found = self._compared.left_by(answers)
        found = np.where(np.isfinite(found), found, np.inf)
        return np.asarray(found.reshape(len(actuators), self._channels, -1))

    def _exact(self, actuator: Any) -> np.ndarray:
        """Answer (6, kept) of the reference, low-passed as `PmsmComparison.answers_of`."""
        other = copy.copy(self._compared)
        other.actuator = actuator
        found = other.exact({})
        assert found is not None  # a recording that begins at rest
        return other.thinned(found)


def equation(compared: PmsmComparison, sheet: Any, fitted: tuple[str, ...]) -> Equation:
    """The response to a healthy recording, with the forms that may be otherwise than in a sheet."""
    response = Response(compared)
    return Equation(
        "response", response.left, response.size, response.least, fitted, _forms(sheet),
        alike=lambda actuator: REFERENCE_ERROR, each=response.each,
    )  # fmt: skip
