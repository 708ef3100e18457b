"""The brushless actuator as a `Model`: its only door to search, reports and commands."""

from typing import Any, ClassVar

import numpy as np

from ematwin.models import servo
from ematwin.models.base import Demand, Equation, Law, Signal, Values
from ematwin.models.bldc import channels as recorded
from ematwin.models.bldc import faults as table
from ematwin.models.bldc.faults import Faults, PaperStudy
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.plausibility import check_phases, check_plausible
from ematwin.models.optional import Likelihood
from ematwin.models.unknown import Contrast, Unknown
from ematwin.recordings.recording import Recording


class BldcModel(servo.ServoModel):
    """Six-step brushless motor, gear with backlash, fault parameters of the ESREL 2020 paper."""

    kind = "bldc"
    title = "brushless motor with six-step drive, gear and backlash"
    parameters = BldcActuator
    channels = recorded.CHANNELS
    needs = ((recorded.PHASES, ("current",)),)
    sample_rate = 20_000.0
    on_request = recorded.ON_REQUEST
    noisy = ()
    fixed = table.FIXED
    compared_rate = 20_000.0
    # Parameters that a healthy recording may determine, and how far a template may be off.
    model_error = table.MODEL_ERROR
    nominal: ClassVar[dict[str, float]] = {
        "motor.emf_constant": 1.1,
        "motor.inertia": 1.3,
        "motor.viscous_damping": 2.0,
        "motor.friction_torque": 1.5,
        "transmission.output_inertia": 1.5,
        "transmission.friction_torque": 1.5,
        "transmission.backlash": 1.5,
        "controller.position_gain": 1.3,
        "controller.speed_gain": 1.3,
    }
    study = PaperStudy(
        severities={"friction": (0.1, 1.0), "backlash": (0.05, 1.0), "gain": (0.2, 1.0)}
    )

    demands = (
        Demand("travel", "rad", ("command", "output_position")),
        Demand("speed", "rad/s", ("output_speed",)),
        Demand("current", "A", recorded.CURRENTS),
        Demand("load", "N*m", ("load",)),
    )

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """The eight components of the paper's fault vector; load and sensors."""
        return (*table.UNKNOWNS, *table.nuisances(actuator))

    aliases = staticmethod(table.aliases)
    other_forms = staticmethod(table.other_forms)

    def simulated(self, *given: Any) -> Any:
        """The response from rest; as of `ServoModel`."""
        from ematwin.models.bldc.simulate import simulate

        return simulate(*given)

    def contrasts(self, actuator: Any) -> tuple[Contrast, ...]:
        """Turns lost by all phases alike, and by each beyond that."""
        return table.CONTRASTS

    def equations(
        self, recording: Recording, actuator: Any, values: Values | None = None
    ) -> tuple[Equation, ...]:
        """Controller and mechanics along the motion, where currents have their sign."""
        from ematwin.models.bldc.forms import equations

        return equations(recording, actuator, values)

    def likelihood(self, recording: Recording, actuator: Any) -> Likelihood | None:
        """Of friction near rest."""
        from ematwin.models.bldc.near_rest import likelihood

        return likelihood(recording, actuator)

    def laws(self, recording: Recording, actuator: Any) -> list[Law]:
        """Phases of a star, sides of the gear, and speeds beside positions."""
        return [*servo.current_laws(recording), *servo.motion_laws(self, recording, actuator)]

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Whether every phase conducts, and the gap is crossed."""
        # Six sectors make a turn of the field. In half of one each pair of phases conducts, and the
        # other half repeats it with the opposite sign.
        said = "half an electrical turn: not every pair of phases takes part"
        return servo.little_motion(recording, actuator, np.pi / actuator.motor.pole_pairs, said)

    def as_faults(self, values: Values) -> Faults:
        """Values by name as a fault vector."""
        return Faults.of({name: values[name] for name in table.FAULTS if name in values})

    def values_of(self, actuator: Any, given: Any) -> dict[str, float]:
        """Values of all eight from `Faults`, a mapping, a vector (8,), or None for healthy."""
        return Faults.of(given).as_dict()

    def compare(self, recording: Recording, actuator: Any, **settings: Any) -> Any:
        """A recording, its equivalent current filtered, scored while candidates are simulated."""
        from ematwin.models.bldc.comparison import BldcComparison

        self.check_channels(recording)
        return BldcComparison(recording, actuator, **settings)

    def averaged(self, recording: Recording) -> Recording:
        """At 20 kHz or a little more; as it is where power is recorded, a product of two means."""
        has_power = any(name in recording.channels for name in recorded.ON_REQUEST)
        return recording if has_power else super().averaged(recording)

    def check_channels(self, recording: Recording) -> None:
        """Command and currents, whole or not at all."""
        check_phases(recording)
        super().check_channels(recording)

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Units, limits, rate, length and wiring."""
        self.check_channels(recording)
        return check_plausible(recording, actuator)

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The reference or the monitor model, sample by sample."""
        from ematwin.models.bldc.simulate import stepped

        return stepped(actuator, fidelity, self.sample_rate)

    def summary(self, recording: Recording, actuator: Any) -> dict[str, float]:
        """RMS and peak of the equivalent current, A."""
        envelope = recorded.current_envelope(recording)
        return {
            "current_rms": float(np.sqrt(np.mean(envelope**2))),
            "current_peak": float(envelope.max()),
        }

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Equivalent current, output position, following error."""
        current = recorded.shown_current(recording, actuator)
        shown = Signal("Equivalent current, 500 Hz low-pass", "A", current)
        return [shown, *servo.tracking_signals(recording)]


MODEL = BldcModel()
