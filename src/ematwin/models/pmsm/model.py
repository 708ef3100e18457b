"""The PMSM servo as a `Model`: its only door to search, reports and commands."""

from typing import Any, ClassVar

import numpy as np

from ematwin.models.base import Demand, Equation, Law, Signal, Study, Values
from ematwin.models.pmsm import channels as recorded
from ematwin.models.pmsm import unknowns as table
from ematwin.models.pmsm.parameters import PmsmActuator
from ematwin.models.pmsm.plausibility import check_phases, check_plausible, laws
from ematwin.models.servo import ServoModel, little_motion, motion_laws, tracking_signals
from ematwin.models.unknown import Contrast
from ematwin.recordings.channel import PHASES
from ematwin.recordings.recording import Recording


class PmsmModel(ServoModel):
    """PMSM servo under field-oriented control, gear with stiffness and play; docs/pmsm.md."""

    kind = "pmsm"
    title = "PMSM servo under field-oriented control, gear and backlash"
    parameters = PmsmActuator
    channels = recorded.CHANNELS
    needs = recorded.NEEDS
    # one descent from healthy finds the valley: the currents' frame turns with the recorded rotor
    default_search = "levenberg-marquardt"
    sample_rate = 10_000.0
    on_request = recorded.ON_REQUEST
    noisy = (*recorded.VOLTAGES, *recorded.TERMINALS)
    fixed = table.FIXED
    # what healthy recordings may determine, and how far a template may be off
    nominal: ClassVar[dict[str, float]] = {
        "motor.resistance": 1.1,
        "motor.inductance_d": 1.15,
        "motor.inductance_q": 1.15,
        "motor.flux": 1.05,
        "motor.inertia": 1.2,
        "motor.viscous_damping": 2.0,
        "motor.friction_torque": 1.5,
        "motor.cogging_torque": 1.5,
        "drive.device_drop": 1.3,
        "controller.position_gain": 1.3,
        "transmission.output_inertia": 1.5,
        "transmission.viscous_damping": 2.0,
        "transmission.friction_torque": 1.5,
        "transmission.backlash": 1.5,
        "transmission.stiffness": 1.5,
        "presliding.damping": 2.0,
    }
    signed: ClassVar[dict[str, float]] = {
        "motor.harmonic_5": 0.05,
        "motor.harmonic_7": 0.05,
        "motor.cogging_phase": 1.0,
    }
    study = Study(severity=(0.1, 0.8))

    demands = (
        Demand("travel", "rad", ("command", "output_position")),
        Demand("speed", "rad/s", ("output_position",), is_rate=True),
        Demand("current", "A", (*PHASES, *recorded.ROTATING)),
        Demand("load", "N*m", ("load",)),
    )

    unknowns = staticmethod(table.unknowns)
    aliases = staticmethod(table.aliases)

    def simulated(self, *given: Any) -> Any:
        """The response from rest; as of `ServoModel`."""
        from ematwin.models.pmsm.simulate import simulate

        return simulate(*given)

    def contrasts(self, actuator: Any) -> tuple[Contrast, ...]:
        """What heat may do as well."""
        return table.CONTRASTS

    def laws(self, recording: Recording, actuator: Any) -> list[Law]:
        """Phases of a star, the drive's control of the current, sides of the gear, speed."""
        return [*laws(recording, actuator), *motion_laws(self, recording, actuator)]

    def equations(
        self, recording: Recording, actuator: Any, values: Values | None = None
    ) -> tuple[Equation, ...]:
        """The response of the loops to a healthy recording; a faulty one has no such equation."""
        if values is not None:
            return ()
        from ematwin.models.pmsm.forms import equation

        known = {place for place, *_ in actuator.parameters()}
        free = {place for place in known if actuator.tolerance(place)}
        free |= known & (self.nominal.keys() | self.signed.keys())
        return (equation(self.compare(recording, actuator), actuator, tuple(sorted(free))),)

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Whether the motor turns, and the gap is crossed."""
        said = "one turn: dynamic eccentricity does not show"
        return little_motion(recording, actuator, 2.0 * np.pi, said)

    def compare(self, recording: Recording, actuator: Any, **settings: Any) -> Any:
        """A recording in the rotor's frame, scored while candidates are simulated."""
        from ematwin.models.pmsm.comparison import PmsmComparison

        self.check_channels(recording)
        return PmsmComparison(recording, actuator, **settings)

    def check_channels(self, recording: Recording) -> None:
        """Command and currents, whole or not at all."""
        check_phases(recording)
        super().check_channels(recording)

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Units, limits, sides of the gear, voltages, and the start."""
        self.check_channels(recording)
        return check_plausible(recording, actuator)

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The reference or the monitor model, sample by sample."""
        from ematwin.models.pmsm.simulate import stepped

        return stepped(actuator, fidelity)

    def rate_of(self, actuator: Any) -> float:
        """Sample rate of the current loops, Hz."""
        return float(1.0 / actuator.controller.current_time)

    def summary(self, recording: Recording, actuator: Any) -> dict[str, float]:
        """RMS and peak of the current vector, A, and the largest following error, rad."""
        found = {}
        currents = recorded.in_rotor_frame(recording, "current", actuator.motor.pole_pairs)
        if currents is not None:
            size = np.hypot(*currents)
            found["current_rms"] = float(np.sqrt(np.mean(size**2)))
            found["current_peak"] = float(size.max())
        if recording.output_position is not None:
            error = recording.command - recording.output_position
            found["following_error_peak"] = float(np.abs(error).max())
        return found

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Currents and voltages in the rotor's frame, position, following error."""
        found = []
        for quantity, unit in (("current", "A"), ("voltage", "V")):
            pair = recorded.in_rotor_frame(recording, quantity, actuator.motor.pole_pairs)
            if pair is not None:
                name = "Current" if quantity == "current" else "Commanded voltage"
                found += [Signal(f"{name}, q", unit, pair[1]), Signal(f"{name}, d", unit, pair[0])]
        return found + tracking_signals(recording)


MODEL = PmsmModel()
