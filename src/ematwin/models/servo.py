"""What kinds share that are a motor with a gear and follow a commanded output position.

Normalised faults, laws of their channels, limits of travel and speed, and signals of figures.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.models.base import Candidates, Law, Model, Progress, Signal, Values
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import recording_of
from ematwin.models.unknown import Unknown, nuisance
from ematwin.numerics.signals import rounding
from ematwin.recordings.channel import PHASES, Channel, Derivation
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from ematwin.showing.text import apart, capital

COMMAND_AND_LOAD = (
    Channel("command", "rad", "commanded output position", ("cmd", "setpoint"), "output"),
    Channel("load", "N*m", "load on the output, against positive motion",
            ("load_torque", "t_load"), "output"),
)  # fmt: skip


class ServoModel(Model):
    """A servo with a reference model, which corrects the fast monitor model."""

    command = "command"
    load = "load"
    fidelities = ("reference", "monitor")

    def sensors(self, actuator: Any) -> tuple[Unknown, ...]:
        """None: a servo's are among its unknowns."""
        return ()

    @abstractmethod
    def simulated(
        self, fidelity: str, actuator: Any, scenario: Scenario, values: Values, rate: float,
        step: float, start: float, progress: Progress | None,
    ) -> tuple[np.ndarray, dict[str, np.ndarray], float]:  # fmt: skip
        """The response from rest: times (S,), all channels (S,) by name, and the step, s.

        As of `ematwin.simulate`; ``step`` is the longest, ``start`` the output's position, rad.
        """

    def simulate(  # type: ignore[override]  # which options there are, a kind decides
        self, actuator: Any, scenario: Scenario, values: Values, *, fidelity: str | None = None,
        sample_rate: float | None = None, step: float | None = None, noise: Noise | None = None,
        seed: int = 0, initial_position: float = 0.0, also: Collection[str] = (),
        progress: Progress | None = None,
    ) -> Recording:  # fmt: skip
        """The response of a model to a scenario; arguments and errors as in `ematwin.simulate`."""
        form, gear = fidelity or self.fidelities[0], actuator.transmission
        if not gear.travel_low <= initial_position <= gear.travel_high:  # NaN fails this as well
            raise InputError(
                f"initial_position must lie within the travel of {actuator.name}, "
                f"{gear.travel_low:.4g} to {gear.travel_high:.4g} rad, received "
                f"{initial_position:g}."
            )
        self.check_scenario(scenario, actuator)
        rate = self.rate_of(actuator) if sample_rate is None else sample_rate
        if not 0.0 < rate < math.inf:
            raise InputError(f"sample_rate must be a positive number of Hz, received {rate}.")
        longest = float(getattr(actuator.steps, form) if step is None else step)
        try:
            actuator.check_step(form, longest)
        except ParameterError as error:
            raise InputError(f"{capital(str(error))}.") from None
        time, channels, taken = self.simulated(
            form, actuator, scenario, values, rate, longest, initial_position, progress
        )
        lacking = [name for name in also if name not in channels]
        if lacking:
            raise InputError(
                f"The {form} model has no {', '.join(lacking)}; take the reference model, or leave "
                "that out."
            )
        wanted = {n: x for n, x in channels.items() if n not in self.on_request or n in also}
        return recording_of(
            self, actuator, scenario, values, time, wanted, noise=noise, seed=seed, fidelity=form,
            initial_position_rad=float(initial_position), step_s=taken,
        )  # fmt: skip

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Responses of the monitor model, low-passed, (B, S) arrays by channel."""
        return self.compare(inputs, actuator).responses(candidates, count)

    def check_scenario(self, scenario: Scenario, actuator: Any) -> None:
        """Raise `ParameterError` if the command leaves the travel."""
        command, _ = scenario.histories(np.linspace(0.0, scenario.duration, 2001))
        gear, low, high = actuator.transmission, float(command.min()), float(command.max())
        if gear.travel_low <= low and high <= gear.travel_high:
            return
        as_degrees = np.radians([low, high])
        fits = gear.travel_low <= as_degrees[0] and as_degrees[1] <= gear.travel_high
        hint = (
            "It looks like degrees; give radians or write the unit."
            if fits and max(-low, high) > 1.0
            else "Shorten the command."
        )
        raise ParameterError(
            f"The command of scenario {scenario.name} reaches {low:.4g} to {high:.4g} rad, beyond "
            f"the end stops of {actuator.name} at {gear.travel_low:.4g} and "
            f"{gear.travel_high:.4g} rad. {hint}"
        )


def star_channels(
    quantity: str, unit: str, meaning: str, aliases: Sequence[str], **more: Any
) -> tuple[Channel, ...]:
    """A channel of each phase of a star winding, minus the sum of the other two.

    ``meaning`` and ``aliases`` hold ``{}`` for the letter; ``more`` is as of `Channel`.
    """
    found = []
    for x in "abc":
        name, sources = f"{quantity}_{x}", tuple(f"{quantity}_{y}" for y in "abc" if y != x)
        derived = Derivation(f"-({' + '.join(sources)})", sources, lambda one, two: -(one + two))
        names = tuple(alias.format(x) for alias in aliases)
        found.append(Channel(name, unit, meaning.format(x), names, derived=derived, **more))
    return tuple(found)


def normalised_fault(
    name: str, meaning: str, unit: str, physical: Callable[[Any, Any], Any] | None,
    healthy: float = 0.0, **more: Any,
) -> Unknown:  # fmt: skip
    """A fault from 0 to 1; ``unit`` of ``physical``, ``more`` as of `Unknown`."""
    return Unknown(
        name, "", meaning, healthy, 0.0, 1.0, physical_unit=unit, physical=physical, **more
    )


def dry_friction(actuator: Any) -> Any:
    """Dry friction of motor and output on the motor shaft, N m."""
    return actuator.motor.friction_torque + actuator.transmission.friction_torque


def possible_coggings(pole_pairs: int) -> list[tuple[int, float]]:
    """Cycles in a turn that the cogging of usual stators may have, each at four phases, rad.

    Magnets are drawn to teeth as many times in a turn as both have in common; magnets that differ
    add the number of slots, teeth that differ the number of poles (Zhu and Howe 2000, IEEE Trans.
    Energy Conversion 15(4), 407-412).
    """
    poles, usual = 2 * pole_pairs, (3, 6, 9, 12, 15, 18, 24)  # slots of stators
    cycles = sorted({poles, *usual, *(math.lcm(slots, poles) for slots in usual)})
    return [(each, 0.5 * math.pi * n) for each in cycles for n in range(4)]


def load_nuisances(actuator: Any, valleys: int = 1) -> tuple[Unknown, Unknown]:
    """Gain and offset of the recorded load; ``valleys`` as of `Unknown`, for the offset.

    Load cells are stated to 1 % of their range and drift by as much with temperature; loads that
    were computed and not measured are worth 5 %. The offset is 5 % of the dry friction.
    """
    load = 0.05 * max(dry_friction(actuator), 1e-6) * actuator.transmission.ratio
    return (
        nuisance("load_gain", "", "actual over recorded load", 1.0, 0.5, 0.06),
        nuisance("load_offset", "N*m", "load beside the recorded one", 0.0, 40.0 * load, load,
                 valleys=valleys),
    )  # fmt: skip


def tracking_signals(recording: Recording) -> list[Signal]:
    """How the output follows its command; nothing where its position is not recorded."""
    if recording.output_position is None:
        return []
    output, command = 1e3 * recording.output_position, 1e3 * recording.command
    return [
        Signal("Output position", "mrad", output, command),
        Signal("Following error", "mrad", command - output),
    ]


def star_laws(recording: Recording, phases: Sequence[str], text: str, most: float) -> list[Law]:
    """Three phases add up to zero (Kirchhoff); ``most`` as a share of their RMS, as of `Law`."""
    if not set(phases) <= recording.channels.keys():
        return []
    values = {name: recording.channels[name] for name in phases}
    size = float(np.sqrt(np.mean([one**2 for one in values.values()])))
    rounded = rounding(np.array([*values.values()]))
    # sensors and converters of phases differ by less than 5 % of it, and by their rounding
    return [
        Law(
            text, values, lambda taken: np.sum([*taken.values()], axis=0), 0.05 * size + rounded,
            most * size + rounded,
        )
    ]  # fmt: skip


def current_laws(recording: Recording) -> list[Law]:
    """The currents of a star winding add up to zero."""
    # no gains of sensors leave a fifth once the best is taken off
    return star_laws(recording, PHASES, "the phase currents do not add up to zero", 0.2)


def motion_laws(model: Model, recording: Recording, actuator: Any) -> list[Law]:
    """Motor and output turn together, but for the gap; a speed is the slope of its position.

    A gap of any size leaves a multiple of the sign of the speed, and the twist of the gear one of
    the load.
    """
    channels, gear = recording.channels, actuator.transmission
    gap = model.unknown(actuator, "backlash")
    widest = gap.physical_value(actuator, gap.upper).value  # rad on the motor shaft
    found = []
    if {"motor_position", "output_position"} <= channels.keys():
        output = channels["output_position"]
        load = channels.get(model.load or "", np.zeros(output.size))
        sides = {
            "motor_position": channels["motor_position"],
            "output_position": np.stack([output, np.sign(np.gradient(output)), load]),
        }

        def apart(taken: Mapping[str, np.ndarray]) -> np.ndarray:
            turned, *shapes = taken["output_position"]
            return np.stack([taken["motor_position"] - gear.ratio * turned, *shapes])

        text = "motor and output do not turn together"
        found.append(Law(text, sides, apart, gear.backlash, play=widest))
    for side in ("motor", "output"):
        position, speed = f"{side}_position", f"{side}_speed"
        if {position, speed} <= channels.keys():
            slope = np.gradient(channels[position], recording.interval)
            both = {speed: channels[speed], position: slope}
            # a drive's own speed may be off by a tenth
            slack = 0.1 * float(np.sqrt(np.mean(channels[speed] ** 2)))
            text = f"{speed} is not the slope of {position}"
            found.append(Law(text, both, lambda taken: np.subtract(*taken.values()), slack))
    return found


def check_motion(recording: Recording, actuator: Any) -> None:
    """Raise `RecordError` if angles leave the travel, or turn faster than the motor ever could."""
    gear, fastest = actuator.transmission, actuator.controller.speed_limit
    motor = recording.channels.get("motor_position")
    speed = 0.0 if motor is None else float(np.abs(np.diff(motor)).max()) * recording.sample_rate
    if speed > 20.0 * fastest:  # no fault makes a motor so fast
        raise RecordError(
            f"motor_position turns at up to {speed:.4g} rad/s; {actuator.name} limits the speed "
            f"to {fastest:.4g} rad/s. Check its unit and the unit of time, or give unwrap = true "
            "in the map if the angle wraps at each full turn."
        )
    for name in ("command", "output_position"):
        values = recording.channels.get(name)
        if values is None:
            continue
        low, high = float(values.min()), float(values.max())
        if low >= 1.02 * gear.travel_low and high <= 1.02 * gear.travel_high:
            continue  # end stops give a little
        factor = max(abs(low), abs(high)) / max(-gear.travel_low, gear.travel_high)
        hint = (
            'It looks like degrees (give unit = "deg" in the map), or else like an angle of the '
            'motor side (give side = "motor").'
            if 10.0 <= factor <= 180.0  # of degrees taken for radians 57.3
            else "Check its unit, its side of the gear and its offset, or the actuator."
        )
        raise RecordError(
            f"{name} runs from {low:.4g} to {high:.4g} rad, beyond the end stops of "
            f"{actuator.name} at {gear.travel_low:.4g} and {gear.travel_high:.4g} rad. {hint}"
        )


def little_motion(recording: Recording, actuator: Any, turn: float, said: str) -> list[str]:
    """Sentences on why a motion cannot tell faults; each forbids a verdict.

    ``turn`` is the least angle of the motor, rad; ``said`` names it and the effect that needs it.
    """
    gear, channels = actuator.transmission, recording.channels
    motor = channels.get("motor_position")
    output = channels.get("output_position", channels["command"])
    travel = float(np.ptp(output) * gear.ratio if motor is None else np.ptp(motor))
    found = []
    if travel < turn:
        moved, needed = apart(float(np.degrees(travel)), float(np.degrees(turn)))
        found.append(
            f"The motor turns by {moved} degrees, less than the {needed} of {said}. Record a "
            f"motion of at least {1e3 * turn / gear.ratio:.3g} mrad of the output."
        )
    if travel < 5.0 * gear.backlash:
        found.append(
            f"The motion is {travel / max(gear.backlash, 1e-12):.2g} times the healthy gap: it "
            "hardly crosses it."
        )
    return found
