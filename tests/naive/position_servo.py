"""A position servo from its equations, by an explicit method at a fine step: slow, and apart.

Written from docs/position-servo.md. Motor and load are one mass (no play); friction is smoothed
over a small speed instead of held at rest; scipy integrates.
"""

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.80665
_STICK = 1e-3  # rad/s over which friction changes its sign


def position(servo, faults, time, goal, load):
    """Position (S,) rad, from rest at the first goal.

    Parameters
    ----------
    servo : parameters by place
    faults : multiples by name
    time, goal : (S,) arrays, s and rad; a goal holds until the next
    load : mass (kg), length (m), arm mass (kg)
    """
    mass, length, arm_mass = load
    payload = faults.get("payload", 1.0)
    weight = payload * (mass + 0.5 * arm_mass) * GRAVITY * length
    inertia = servo["gear.inertia"] + payload * (mass + arm_mass / 3.0) * length**2
    delay = servo["controller.delay"] * faults.get("delay", 1.0)
    gain = servo["controller.gain"] * faults.get("gain", 1.0)
    weak, rubs = faults.get("torque", 1.0), faults.get("friction", 1.0)
    stall = servo["motor.stall_torque"] * weak
    back_emf = servo["motor.stall_torque"] / servo["motor.no_load_speed"] * weak**2
    step = 2.0 * np.pi / 4096.0

    # the target is limited in its rate whatever the servo does
    fine = np.linspace(time[0], time[-1], 20 * (len(time) - 1) + 1)
    late = goal[np.maximum(np.searchsorted(time, fine - delay, side="right") - 1, 0)]
    target = np.empty_like(late)
    target[0] = goal[0]
    most = servo["controller.speed_limit"] * (fine[1] - fine[0])
    for n in range(1, len(late)):
        target[n] = target[n - 1] + np.clip(late[n] - target[n - 1], -most, most)

    def slope(t, state):
        theta, w = state
        error = np.interp(t, fine, target) - (theta - 0.5 * servo["controller.interval"] * w)
        startup = servo["controller.startup"] * np.clip(error / step, -1.0, 1.0)
        duty = np.clip(gain * error + startup, -1.0, 1.0)
        gravity = weight * np.sin(theta)
        fading = 1.0 / (1.0 + (w / servo["friction.stribeck_speed"]) ** 2)
        coulomb = servo["friction.coulomb"] + servo["friction.load_share"] * abs(gravity)
        static = servo["friction.stribeck"] + servo["friction.static_share"] * abs(gravity)
        dry = coulomb + fading * static
        linear = stall * duty - back_emf * w
        torque = linear / np.sqrt(1.0 + (linear / (weak * servo["motor.saturation_torque"])) ** 2)
        return [w, (torque - gravity - rubs * dry * np.tanh(w / _STICK)) / inertia]

    found = solve_ivp(
        slope, (time[0], time[-1]), [goal[0], 0.0], method="LSODA", t_eval=time,
        max_step=5e-3, rtol=1e-6, atol=1e-8,
    )  # fmt: skip
    return found.y[0]
