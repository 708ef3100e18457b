"""Faults and other unknowns of a brushless actuator: names, bounds, laws, priors and errors.

ESREL 2020 paper, sections 6 and 7.1. The magnitudes are normalised to [0, 1]; the laws that turn
them into physical ones are those that the kernel compiles (`ematwin.models.bldc.constants`).
"""

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import cache
from typing import Any

import numpy as np

from ematwin.errors import InputError
from ematwin.models.base import OtherForm, Study, Values
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.sections import ShortedTurns
from ematwin.models.servo import dry_friction, load_nuisances
from ematwin.models.servo import normalised_fault as _fault
from ematwin.models.unknown import (
    Alias,
    Contrast,
    PhysicalValue,
    Unknown,
    nuisance,
    physical_html,
    table_of,
)
from ematwin.showing.results import frame


def friction_factor(k: Any) -> Any:
    """Factor on all dry friction."""
    return 1.0 + 2.0 * k


def backlash_factor(k: Any) -> Any:
    """Factor on the healthy backlash."""
    return 1.0 + 99.0 * k


def turns_left(k: Any) -> Any:
    """Share of the turns of a phase that are left."""
    return 1.0 - k


def eccentricity_angle(k: Any) -> Any:
    """Direction of the eccentricity, rad."""
    return 2.0 * math.pi * (k - 0.5)


def gain_factor(k: Any) -> Any:
    """Factor on the position gain."""
    return 0.5 + k


UNKNOWNS = (
    _fault("friction", "dynamic dry friction on the motor shaft", "N m",
           lambda a, k: dry_friction(a) * friction_factor(k)),
    # the misfit has separate minima for a small, a middling and a large gap
    _fault("backlash", "backlash on the motor shaft", "rad",
           lambda a, k: a.transmission.backlash * backlash_factor(k), valleys=3),
    *(
        _fault(f"short_{x}", f"shorted turns in phase {x}", "turns",
               lambda a, k: (n := a.motor.turns_per_phase) - n * turns_left(k))
        for x in "abc"
    ),
    _fault("eccentricity", "rotor offset over air gap", "", None),
    _fault("eccentricity_phase", "direction of the eccentricity", "deg",
           lambda a, k: np.degrees(eccentricity_angle(k)), 0.5,
           direction_of="eccentricity"),
    _fault("gain", "proportional position gain", "1/s",
           lambda a, k: a.controller.position_gain * gain_factor(k), 0.5),
)  # fmt: skip

FAULTS = tuple(one.name for one in UNKNOWNS)


def fault_vector(given: Values) -> np.ndarray:
    """(8,) of faults by name, which may lie beyond their bounds while a healthy twin is judged."""
    return np.array([given.get(one.name, one.healthy) for one in UNKNOWNS])


LOAD = ("load_gain", "load_offset")  # corrections of the recorded load
HELD = "integral"  # A, of the speed loop's demand
ZERO = "output_zero"  # rad on the motor shaft, of command and output beside the motor
POWER = ("power_gain", "power_offset", "voltage_drop")  # of the recorded power
SENSOR = ("skew", "current_gain", "current_offset", *POWER)  # what sensors make of the answer

# of the monitor model where the reference does not correct it: 95 % of errors on records of the
# reference lie within 2 standard errors (``python benchmarks/identification.py --coverage``)
MODEL_ERROR = 3.5
_POWER_OFFSET = 0.001  # of the largest power that the drive can take
_CURRENT_OFFSET = 0.005  # of the current limit: Hall sensors state 0.5 to 1 % of their range


def nuisances(actuator: Any) -> tuple[Unknown, ...]:
    """Load and sensors, which differ from recording to recording; all by one standard deviation.

    Hall current sensors are usually stated to 1 % of their range and drift by as much with
    temperature. Loggers that do not share a clock are some samples apart. Voltages, by dividers,
    and a supply's current, by a shunt, are known to 1 % with 95 %. A drive takes some power for
    itself, and its switches drop a volt or two. What an integral term asks for at first is
    within the current limit. Zeros of motor and output are some gaps apart, or known better; one
    that currents show is known within 5 degrees electrical.
    """
    limit = actuator.drive.current_limit
    current, gap = _CURRENT_OFFSET * limit, actuator.transmission.backlash
    power = _POWER_OFFSET * limit * actuator.drive.supply_voltage
    apart = max(gap, math.radians(2.5) / actuator.motor.pole_pairs)
    return (
        nuisance("skew", "s", "how late the command was recorded", 0.0, 1e-3, 2e-4),
        *load_nuisances(actuator, valleys=7),  # stiction holds elsewhere
        nuisance("current_gain", "", "gain of the current sensor", 1.0, 0.1, 0.01),
        nuisance("current_offset", "A", "offset of the current sensor", 0.0, 20 * current, current),
        nuisance(HELD, "A", "of the speed loop's integral term at first", 0.0, limit, 0.5 * limit),
        nuisance(
            ZERO, "rad", "zero of command and output beside the motor's", 0.0, 20 * apart, apart
        ),
        nuisance("power_gain", "", "recorded over actual electrical power", 1.0, 0.2, 0.005),
        nuisance("power_offset", "W", "power beside that of the motor", 0.0, 20 * power, power),
        nuisance("voltage_drop", "V", "voltage lost in the drive", 0.0, 10.0, 1.0),
    )


_EFFICIENCIES = ("transmission.efficiency_opposing", "transmission.efficiency_aiding")
SHORTS = ("short_a", "short_b", "short_c")


def aliases(actuator: Any, values: Mapping[str, float]) -> list[Alias]:
    """Directions in which no channel changes: faults against the parameters that they multiply."""
    k = {name: values.get(name, fault(name).healthy) for name in FAULTS}
    opposing, aiding = (values.get(place, actuator.value(place)) for place in _EFFICIENCIES)
    found = [
        # the fault multiplies the friction under load as well
        Alias("transmission.friction_torque", {
            "friction": 0.5 + k["friction"], "motor.friction_torque": -1.0,
            _EFFICIENCIES[0]: 1.0 - opposing, _EFFICIENCIES[1]: (1.0 - aiding) / aiding,
        }),
        Alias("transmission.backlash", {"backlash": (1.0 + 99.0 * k["backlash"]) / 99.0}),
        Alias("controller.position_gain", {"gain": 0.5 + k["gain"]}),
    ]  # fmt: skip
    contact = actuator.shorted_turns
    if contact is not None and any(k[name] > 0.0 for name in SHORTS):
        r_f, r = contact.resistance, 0.5 * actuator.motor.resistance
        same = {
            name: -r_f * k[name] / (2.0 * r_f + k[name] * r) for name in SHORTS if k[name] > 0.0
        }
        found.append(Alias("shorted_turns.resistance", same))
    return found


def _turns(actuator: Any, k: float) -> float:
    """Of a phase, of a share of them."""
    return float(actuator.motor.turns_per_phase * k)


CONTRASTS = (
    Contrast(
        "short_common", dict.fromkeys(SHORTS, 1.0 / 3.0), "turns missing, mean of the phases",
        "Turns missing from all phases alike cannot be told from warm magnets nor, unless phase "
        "voltages are recorded, from the gain of a current sensor.", "turns", _turns,
    ),
    *(
        Contrast(
            f"{name}_beyond_common",
            {one: (2.0 if one == name else -1.0) / 3.0 for one in SHORTS},
            f"shorted turns in phase {name[-1]} beyond the mean of the phases", "", "turns", _turns,
        )
        for name in SHORTS
    ),
)  # fmt: skip


# Sections of forms that the reference model alone has (docs/models.md, "Truer forms").
REFERENCE_ALONE = (
    "emf", "torque_ripple", "cogging", "presliding", "winding_heat", "supply", "speed_loop",
    "current_loop", "compliance", "encoder",
)  # fmt: skip
# Known exactly, or of no effect on the monitor model: these cannot differ between candidates.
FIXED = (
    "motor.pole_pairs", "motor.turns_per_phase", "transmission.ratio", "steps.reference",
    "steps.monitor", "speed_loop.sample_time", "speed_loop.delay", "current_loop.sample_time",
    "current_loop.delay", "encoder.motor_steps", "encoder.output_steps",
)  # fmt: skip


@cache
def fault(name: str) -> Unknown:
    """The fault of a name."""
    return next(one for one in UNKNOWNS if one.name == name)


def other_forms(actuator: BldcActuator, found: Mapping[str, float]) -> tuple[OtherForm, ...]:
    """Forms that a file leaves out and for which missing turns may be mistaken."""
    mistaken = frozenset((*SHORTS, "eccentricity"))
    forms = []
    if actuator.eccentricity is None:
        forms.append(OtherForm(
            actuator.changed({"eccentricity.turning_share": 0.0}),
            "an eccentricity that is fixed in space", "[eccentricity] with turning_share = 0",
            ("eccentricity", "eccentricity_phase"), mistaken, (fixed_in_space(found),),
        ))  # fmt: skip
    if actuator.shorted_turns is None:
        healthy = {**found, **dict.fromkeys(SHORTS, 0.0)}
        rested = {**healthy, "friction": 0.0, "gain": 0.5}  # what a brake was taken for
        starts = tuple(
            {**start, phase: share}
            for start in (healthy, rested) for phase in SHORTS for share in (0.05, 0.15, 0.4)
        )  # fmt: skip
        forms.append(OtherForm(
            actuator.changed({"shorted_turns.resistance": ShortedTurns.example["resistance"]}),
            "shorted turns that carry a current of their own",
            "[shorted_turns] with the resistance of the contact", SHORTS, mistaken, starts,
        ))  # fmt: skip
    return tuple(forms)


def fixed_in_space(found: Mapping[str, float]) -> dict[str, float]:
    """The offset with which each phase has the constant that missing turns give it.

    Three numbers h_k = 1 - short_k are c (1 + zeta cos(phi - 2 pi k/3)), k = 0, 1, 2, for exactly
    one c, zeta and phi.
    """
    left = [1.0 - found.get(name, 0.0) for name in SHORTS]
    mean = max(sum(left) / 3.0, 1e-6)
    offset = (
        sum(h * cmath.exp(2j * math.pi / 3.0 * k) for k, h in enumerate(left)) * 2.0 / (3.0 * mean)
    )
    start = {**found, **dict.fromkeys(SHORTS, 0.0)}
    start["eccentricity"] = min(abs(offset), 0.95)  # of the air gap
    start["eccentricity_phase"] = (cmath.phase(offset) / (2.0 * math.pi) + 0.5) % 1.0
    place = "motor.emf_constant"
    if place in found:
        start[place] = found[place] * mean
    return start


HEALTHY = np.array([one.healthy for one in UNKNOWNS])
HEALTHY.flags.writeable = False

# Table 1 of the paper: the ten fault vectors, in its order.
PAPER_CASES = {
    "Low F": {"friction": 0.25},
    "High F": {"friction": 0.75},
    "Low B": {"backlash": 0.10},
    "High B": {"backlash": 0.75},
    "High Na": {"short_a": 0.80},
    "Low Na": {"short_a": 0.30},
    "Low Z": {"eccentricity": 0.25},
    "High Z": {"eccentricity": 0.75},
    "Low Gain": {"gain": 0.25},
    "High Gain": {"gain": 0.75},
}


@dataclass(frozen=True)
class Faults:
    """A fault vector: eight magnitudes in [0, 1], healthy by default.

    `print` shows physical values on the default actuator, `physical` on any.

    Raises `InputError` if a value is not a number in [0, 1].
    """

    friction: float = 0.0
    backlash: float = 0.0
    short_a: float = 0.0
    short_b: float = 0.0
    short_c: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.5
    gain: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = fault(field.name).check(getattr(self, field.name))
            object.__setattr__(self, field.name, value)

    @classmethod
    def of(cls, values: "Faults | Mapping[str, float] | np.ndarray | None") -> "Faults":
        """Faults from a mapping of names to values, a vector (8,), or None for healthy."""
        if values is None:
            return cls()
        if isinstance(values, Faults):
            return values
        if isinstance(values, Mapping):
            for name in values:
                if name not in FAULTS:
                    close = get_close_matches(name, FAULTS, n=1, cutoff=0.5)
                    hint = f"Did you mean {close[0]}? " if close else ""
                    raise InputError(
                        f"Unknown fault {name!r}. {hint}The faults are {', '.join(FAULTS)}."
                    )
            return cls(**values)
        vector = np.asarray(values, dtype=float)
        if vector.shape != (8,):
            raise InputError(
                f"A fault vector has 8 components ({', '.join(FAULTS)}), received shape "
                f"{vector.shape}."
            )
        return cls(*vector.tolist())

    @property
    def vector(self) -> np.ndarray:
        """(8,) array in the order of `FAULTS`."""
        return np.array([getattr(self, name) for name in FAULTS])

    def as_dict(self) -> dict[str, float]:
        """Names and normalised values."""
        return {name: getattr(self, name) for name in FAULTS}

    def physical(self, actuator: "BldcActuator | str | None" = None) -> list[PhysicalValue]:
        """The physical value of each component on an actuator (the default one if None)."""
        chosen = BldcActuator.load() if actuator is None else BldcActuator.load(actuator)
        from ematwin.models.bldc.model import MODEL

        return MODEL.describe(chosen, self.as_dict())

    def describe(self, actuator: "BldcActuator | str | None" = None) -> str:
        """A table for people: each component, normalised and physical, against healthy."""
        return table_of(self.physical(actuator))

    def __str__(self) -> str:
        return self.describe()

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each component, by name; needs pandas."""
        return frame((row._asdict() for row in self.physical()), "name")

    to_dataframe = to_frame

    def _repr_html_(self) -> str:
        """Physical values on the default actuator, in a notebook."""
        return physical_html(repr(self), self.physical())

    def __repr__(self) -> str:
        given = [
            f"{name}={value:g}"
            for (name, value), healthy in zip(self.as_dict().items(), HEALTHY, strict=True)
            if value != healthy
        ]
        return f"Faults({', '.join(given)})"


def error_percent(
    estimated: np.ndarray, injected: np.ndarray, *, wrapped: bool = False
) -> np.ndarray:
    """Err% of the paper (section 7.1), (...) array, in its exact form unless ``wrapped``.

    100 sqrt( sum_{1..6} (k - k^)^2 + k^_6 (k_7 - k^_7)^2 + (k_8 - k^_8)^2 ), k^ injected; both
    (..., 8) arrays. ``wrapped`` takes the direction as an angle: k_7 = 0 and k_7 = 1 are the same.
    """
    k_hat = np.asarray(injected)
    gap = np.asarray(estimated) - k_hat
    turn = gap[..., 6]
    if wrapped:
        turn = turn - np.round(turn)
    total = (gap[..., :6] ** 2).sum(axis=-1) + k_hat[..., 5] * turn**2 + gap[..., 7] ** 2
    return np.asarray(100.0 * np.sqrt(total))


def error_percent_wrapped(estimated: np.ndarray, injected: np.ndarray) -> np.ndarray:
    """`error_percent` with the direction of the eccentricity as an angle."""
    return error_percent(estimated, injected, wrapped=True)


class PaperStudy(Study):
    """The paper's cases and its error measure."""

    def cases(self, faults: tuple[Unknown, ...]) -> dict[str, dict[str, float]]:
        """Table 1 of the paper."""
        return PAPER_CASES

    def error_percent(
        self, faults: tuple[Unknown, ...], found: Values, injected: Values, *, wrapped: bool = False
    ) -> float:
        """Err% of the paper; ``wrapped`` takes the direction of the eccentricity as an angle."""
        one, other = (np.array([values[name] for name in FAULTS]) for values in (found, injected))
        return float(error_percent(one, other, wrapped=wrapped))
