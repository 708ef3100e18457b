"""Forms that healthy recordings of a PMSM servo may show though its file has them otherwise.

The controller of such a servo is sampled and known. Cogging and friction that gives before it
slides are looked for in the response of the closed loops, which is smooth.
"""

import copy
import math
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from ematwin.models.optional import Candidate, Equation, Form, Values
from ematwin.models.pmsm.comparison import REFERENCE_ERROR, PmsmComparison
from ematwin.models.servo import load_nuisances, possible_coggings
from ematwin.numerics.signals import white_noise

_COGGING = ("motor.cogging_torque", "motor.cogging_periods", "motor.cogging_phase")
_BRISTLES = (
    "presliding.motor_stiffness", "presliding.output_stiffness", "presliding.damping",
)  # fmt: skip


def _coggings(actuator: Any) -> list[Values]:
    torque = max(actuator.motor.cogging_torque, 0.3 * actuator.motor.friction_torque)
    return [
        dict(zip(_COGGING, (torque, *each), strict=True))
        for each in possible_coggings(actuator.motor.pole_pairs)
    ]


def _bristles(actuator: Any) -> list[Values]:
    """All pairs of both sides: begun alike, stiffnesses may miss the best pair."""
    gear = actuator.transmission
    motor = gear.static_ratio * actuator.motor.friction_torque
    output = gear.static_ratio * gear.friction_torque
    bent = (3e-4, 6e-4, 1e-3, 2e-3, 4e-3, 8e-3)  # rad on the motor shaft, before friction slides
    return [
        dict(zip(_BRISTLES, (motor / one, output / other, 0.01), strict=True))
        for one, other in product(bent, bent)
    ]


def _forms(sheet: Any) -> tuple[Form, ...]:
    """Forms that are otherwise than in the sheet."""

    def cogs_otherwise(actuator: Any) -> bool:
        return any(actuator.value(place) != sheet.value(place) for place in _COGGING[1:])

    return (
        Form(
            "cogging", cogs_otherwise, _COGGING, _coggings,
            lambda a: f"cogging of {1e3 * a.motor.cogging_torque:.2g} mN m, "
                      f"{a.motor.cogging_periods} a turn",
            ("motor.cogging_torque", "motor.cogging_phase"),
        ),
        Form(
            "presliding friction", lambda a: a.presliding is not None, _BRISTLES, _bristles,
            lambda a: "friction of the motor gives "
                      f"{1e3 * a.motor.friction_torque / a.presliding.motor_stiffness:.2g} mrad "
                      "before it slides",
            _BRISTLES, _bristles,
        ),
    )  # fmt: skip


class Response:
    """The twin's response less the recording, in standard deviations of noise.

    The monitor model answers, corrected by the reference, whose own differences are rough, at one
    actuator. Gain and offset of the load cell are fitted within what is known of them. A recording
    that begins in motion has the ``size`` 0.
    """

    def __init__(self, compared: PmsmComparison, actuator: Any) -> None:
        self._compared = compared.with_missed({})
        self._channels = len(compared.measured())
        self.size = math.sqrt(self._compared.scale) if compared.before else 0.0
        self._missed: np.ndarray | float = 0.0
        if self.size:
            exact = copy.copy(compared)
            exact.actuator = actuator
            found = exact.exact({})
            assert found is not None  # a recording that begins at rest
            self._missed = exact.thinned(found) - exact.answers_of([actuator])[0]
            self._load = self._by_load(actuator)

    def _by_load(self, actuator: Any) -> np.ndarray:
        """Changes (2, K) of the residual by gain and offset of the load, one deviation each."""
        cell = load_nuisances(actuator)
        steps = np.array([one.spread for one in cell], dtype=float)
        candidates = {
            one.name: one.healthy + steps[n] * np.array([0.0, n == 0, n == 1])
            for n, one in enumerate(cell)
        }
        twin = copy.copy(self._compared)
        twin.actuator = actuator
        here, *moved = twin.residuals(candidates, 1 + len(cell))
        found = np.array(moved) - here
        return found if np.isfinite(found).all() else 0.0 * found

    def least(self, actuator: Any) -> float:
        """Share of the recording that noise and the error of the reference leave."""
        rows = self._rows([actuator])[0]
        noise = math.sqrt(sum(white_noise(row) ** 2 * row.size for row in rows))
        return math.hypot(noise / self.size, REFERENCE_ERROR)

    def left(self, actuator: Any, values: Values) -> np.ndarray:
        """Residual (K,), one part of the recording after the other."""
        return self.each([(actuator, values)])[0]

    def each(self, candidates: Sequence[Candidate]) -> list[np.ndarray]:
        """The same of several actuators, side by side in the lanes of the twin."""
        found = []
        for rows in self._rows([actuator for actuator, _ in candidates]):
            parts = np.array_split(rows, 60, axis=1)  # within a part channels follow each other
            found.append(np.concatenate([part.ravel() for part in parts]))
        return found

    def _rows(self, actuators: Sequence[Any]) -> np.ndarray:
        """Residual (B, C, S) of each channel; infinite where the twin diverged."""
        found = self._compared.left_by(self._compared.answers_of(actuators) + self._missed)
        finite = np.isfinite(found).all(axis=1)
        found[~finite] = np.inf
        inside = np.linalg.inv(np.eye(len(self._load)) + self._load @ self._load.T)
        found[finite] -= found[finite] @ self._load.T @ inside @ self._load
        return np.asarray(found.reshape(len(actuators), self._channels, -1))


def equation(
    compared: PmsmComparison, sheet: Any, fitted: tuple[str, ...], actuator: Any = None
) -> Equation:
    """The response to a healthy recording, corrected at an actuator, or that of the sheet."""
    response = Response(compared, actuator or sheet)
    smooth = tuple(place for place in fitted if place != _COGGING[2])  # half a turn off it is stuck
    return Equation(
        "response", response.left, response.size, response.least, smooth, _forms(sheet),
        each=response.each, near=partial(equation, compared, sheet, fitted),
    )  # fmt: skip
