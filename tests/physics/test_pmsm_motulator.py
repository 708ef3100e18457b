"""The healthy servo against motulator, drive simulation software that nobody here wrote.

motulator (Hinkkanen et al., MIT licence) has the motor, the inverter and a two-mass gear with its
own solver and its own one-sample delay; the loops around them are the naive ones of `naive.pmsm`.
"""

from types import SimpleNamespace

import numpy as np
from motulator.drive import model
from motulator.drive.utils import SynchronousMachinePars, TwoMassMechanicalSystemPars

from naive.pmsm import PHASES, Drive, settings
from pmsm_inputs import ACTUATOR, SMOOTH, TICK, healthy, reference, smooth_move

LIMIT = 0.01  # of the RMS, as the project asks
DURATION = 0.12
LOAD, LOAD_AT = 0.8, 0.08  # N m on the motor shaft


class Controller:
    """The naive loops as motulator calls a control system."""

    def __init__(self, actuator, command):
        self.drive, self.command = Drive(settings(actuator)), command
        self.actuator, self.tick, self.turned, self.log = actuator, 0, 0.0, []

    def __call__(self, plant):
        machine, mechanics = plant.machine, plant.mechanics
        angle = np.angle(machine.state.exp_j_theta_m)
        self.turned += (angle - self.turned + np.pi) % (2.0 * np.pi) - np.pi
        theta_m = self.turned / self.actuator.motor.pole_pairs
        theta_o = theta_m - complex(mechanics.state.theta_ML).real
        i_a, i_b, _ = machine.meas_currents()
        command = self.command[min(self.tick, len(self.command) - 1)]
        i, v, _ = self.drive(command, theta_m, theta_o, i_a, i_b)
        self.log.append((i, v, theta_m, theta_o, complex(mechanics.state.w_M).real))
        self.tick += 1
        # motulator delays the duty ratios itself, so it is given the voltage of this tick
        vector = self.drive.pending / self.actuator.drive.supply_voltage
        return TICK, [0.5 + (vector * np.exp(-1j * place)).real for place in PHASES]

    def post_process(self):
        """Nothing is left to do."""


def of_motulator(actuator, command):
    """Logged columns of the servo in motulator."""
    motor, gear = actuator.motor, actuator.transmission
    plant = model.Drive(
        model.VoltageSourceConverter(u_dc=actuator.drive.supply_voltage),
        model.SynchronousMachine(SynchronousMachinePars(
            n_p=motor.pole_pairs, R_s=motor.resistance, L_d=motor.inductance_d,
            L_q=motor.inductance_q, psi_f=motor.flux,
        )),
        model.TwoMassMechanicalSystem(
            TwoMassMechanicalSystemPars(
                J_M=motor.inertia, J_L=gear.output_inertia, K_S=gear.stiffness, C_S=0.0,
                B_L=gear.viscous_damping,
            ),
            tau_L=lambda t: LOAD * (t >= LOAD_AT - 0.5 * TICK),
        ),
    )  # fmt: skip
    control = Controller(actuator, command)
    run = model.Simulation(plant, control)
    run.mdl.post_process = lambda: None
    run.simulate(t_stop=(len(command) - 1.5) * TICK, max_step=TICK / 4)
    return SimpleNamespace(
        **dict(zip(("i", "v", "theta_m", "theta_o", "w_m"),
                   map(np.array, zip(*control.log, strict=True)), strict=True))
    )  # fmt: skip


def test_currents_voltages_and_motion_are_those_of_motulator_within_one_per_cent():
    actuator = ACTUATOR.changed(SMOOTH)
    command = smooth_move(actuator, DURATION, 12.0)
    theirs = of_motulator(actuator, command)
    time = np.arange(command.size) * TICK
    # a load that steps at a tick steps there for us as well: nothing in between
    load = np.where(time >= LOAD_AT - 0.5 * TICK, LOAD, 0.0)
    ours = reference(actuator, healthy(actuator), command, load)
    n = min(len(theirs.i), command.size)
    pairs = {
        "current_q": (ours["current_q"], theirs.i.imag),
        "current_d": (ours["current_d"], theirs.i.real),
        "voltage_q": (ours["voltage_q"], theirs.v.imag),
        "voltage_d": (ours["voltage_d"], theirs.v.real),
        "motor_speed": (ours["motor_speed"], theirs.w_m),
        "following error": (command - ours["output_position"], command[:n] - theirs.theta_o[:n]),
    }
    sizes = {"current_d": np.abs(theirs.i), "voltage_d": np.abs(theirs.v)}
    for name, (own, other) in pairs.items():
        size = np.sqrt(np.mean(sizes.get(name, other)[:n] ** 2))
        gap = np.sqrt(np.mean((own[:n] - other[:n]) ** 2))
        assert gap < LIMIT * size, f"{name} differs by {100 * gap / size:.2f} %"
    # the move asks for something: transients, not only a steady state
    assert np.abs(theirs.i.imag).max() > 2.0
    last = slice(n - 20, n)
    steady = np.mean(ours["current_q"][last]) / np.mean(theirs.i.imag[last])
    assert abs(steady - 1.0) < LIMIT
