"""Channels of a recording of a PMSM servo, and what follows from them."""

from typing import Any

import numpy as np

from ematwin.models.servo import COMMAND_AND_LOAD, star_channels
from ematwin.recordings.channel import PHASES, Channel, Derivation
from ematwin.recordings.recording import Recording

VOLTAGES = ("voltage_a", "voltage_b", "voltage_c")
TERMINALS = ("terminal_voltage_a", "terminal_voltage_b", "terminal_voltage_c")
LINES = ("line_voltage_ab", "line_voltage_bc")
ROTATING = ("current_d", "current_q")
ROTATING_VOLTAGES = ("voltage_d", "voltage_q")


_BY_LINES = {
    "a": Derivation("(2 ab + bc)/3", LINES, lambda ab, bc: (2.0 * ab + bc) / 3.0),
    "b": Derivation("(bc - ab)/3", LINES, lambda ab, bc: (bc - ab) / 3.0),
    "c": Derivation("-(ab + 2 bc)/3", LINES, lambda ab, bc: -(ab + 2.0 * bc) / 3.0),
}
CHANNELS = (
    *COMMAND_AND_LOAD,
    *star_channels("current", "A", "current of phase {}", ("i_{}",)),
    Channel("current_d", "A", "current along the magnets, as the drive sees it", ("i_d",),
            may_rest=True),
    Channel("current_q", "A", "current across the magnets, as the drive sees it", ("i_q",)),
    *star_channels("voltage", "V", "commanded voltage of phase {}", ("v_{}", "u_{}")),
    Channel("voltage_d", "V", "commanded voltage along the magnets", ("v_d", "u_d")),
    Channel("voltage_q", "V", "commanded voltage across the magnets", ("v_q", "u_q")),
    *(
        Channel(f"terminal_voltage_{x}", "V", f"measured voltage of phase {x}, mean over the PWM "
                "period that ends at the sample", (f"v_meas_{x}",), derived=derived)
        for x, derived in _BY_LINES.items()
    ),
    *(
        Channel(name, "V", f"measured voltage of phase {name[-2]} over phase {name[-1]}, mean over "
                "the PWM period that ends at the sample", (f"v_{name[-2:]}",))
        for name in LINES
    ),
    Channel("motor_position", "rad", "motor shaft angle, as the drive reads it", ("theta_m",),
            "motor"),
    Channel("motor_speed", "rad/s", "motor shaft speed", ("omega_m",), "motor"),
    Channel("output_position", "rad", "output angle", ("theta_o",), "output"),
)  # fmt: skip
ON_REQUEST = (*ROTATING, *ROTATING_VOLTAGES, *TERMINALS, "motor_speed")  # of a simulation
NEEDS = (((*PHASES, "motor_position"), ROTATING),)


def to_rotor(a: np.ndarray, b: np.ndarray, c: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Phases (S,) as d and q (2, S) in a frame at an electrical angle (S,), rad; peaks stay."""
    vector = (2.0 / 3.0) * (a + b * np.exp(2j * np.pi / 3.0) + c * np.exp(-2j * np.pi / 3.0))
    turned = vector * np.exp(-1j * angle)
    return np.stack([turned.real, turned.imag])


def to_phases(d: Any, q: Any, angle: Any) -> tuple[Any, Any, Any]:
    """d and q as the phases a, b, c, numbers or arrays (inverse Park and Clarke transforms)."""
    s, co = np.sin(angle), np.cos(angle)
    alpha, beta = co * d - s * q, s * d + co * q
    far = 0.5 * np.sqrt(3.0) * beta
    return alpha, far - 0.5 * alpha, -0.5 * alpha - far


def in_rotor_frame(
    recording: Recording, quantity: str, pole_pairs: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """d and q (S,) of "current", "voltage" or "terminal_voltage"; None without."""
    channels = recording.channels
    rotating, phases = ([f"{quantity}_{x}" for x in letters] for letters in ("dq", "abc"))
    if set(rotating) <= channels.keys():
        return channels[rotating[0]], channels[rotating[1]]
    if not {*phases, "motor_position"} <= channels.keys():
        return None
    a, b, c = (channels[name] for name in phases)
    d, q = to_rotor(a, b, c, pole_pairs * channels["motor_position"])
    return d, q
