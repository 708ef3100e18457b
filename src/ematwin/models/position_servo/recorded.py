"""Channels of a recording of a servo, and the compared part of it.

A serial bus gives now and then a false position, and a servo that is overloaded cuts its torque.
False reads have no weight. Only the longest stretch with torque is compared, and of it what comes
before a trip of the protection.
"""

from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import RecordError
from ematwin.models.position_servo.parameters import unknowns
from ematwin.recordings.channel import Channel
from ematwin.recordings.cleaning import runs
from ematwin.recordings.recording import Recording
from ematwin.showing.text import counted

CHANNELS = (
    Channel("goal_position", "rad", "commanded position, 0 where a pendulum hangs down",
            ("goal", "command", "target_position", "present_goal")),
    Channel("position", "rad", "position of the output", ("present_position",), "output",
            refreshed=0.008),
    Channel("supply_voltage", "V", "supply voltage of the servo",
            ("voltage", "present_voltage", "present_input_voltage"), may_rest=True),
    Channel("temperature", "", "temperature register of the servo, degC",
            ("present_temperature",), may_rest=True),
    Channel("torque_enabled", "", "1 with torque, 0 where it is released", ("torque_enable",),
            may_rest=True),
    Channel("mass", "kg", "point mass at the end of the arm", ("payload_mass",), may_rest=True),
    Channel("length", "m", "from the shaft to the mass", ("arm_length",), may_rest=True),
    Channel("arm_mass", "kg", "mass of the arm", may_rest=True),
)  # fmt: skip
_SHORTEST = 20  # samples that are compared
_LASTS = 0.25  # s: an arm that overshoots has turned round by then


class Stretch(NamedTuple):
    """The part of a recording that is compared."""

    first: int  # sample
    stop: int
    false: np.ndarray  # (S,) of bool, false reads and what interpolation made of their neighbours
    said: list[str]  # sentences on omitted parts
    obstacles: list[str]  # sentences on why no verdict can rest on it


def stretch(recording: Recording, actuator: Any) -> Stretch:
    """Find the part of a recording that is compared."""
    channels, time = recording.channels, recording.time
    size, interval = len(recording), recording.interval
    position, said, obstacles = channels["position"], [], []
    false = false_reads(position, 3.0 * actuator.motor.no_load_speed * interval)
    parts = runs(channels.get("torque_enabled", np.ones(size)) > 0.5)
    first, stop = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
    if stop == first:
        said.append("The torque is released throughout: nothing can be compared.")
    elif stop - first < size:
        said.append(
            f"The torque is released outside of {time[first]:.2f} to {time[stop - 1]:.2f} s: only "
            "that stretch is compared."
        )
    reads = runs(false[first:stop])
    if reads:
        said.append(
            f"{counted(len(reads), 'false read')} of the position, the first at "
            f"{time[first + reads[0][0]]:.2f} s, left out."
        )
    sound = np.flatnonzero(~false[first:stop]) + first
    goal, moves = channels["goal_position"][sound], position[sound]
    moving = sound.size > _SHORTEST and min(np.ptp(goal), np.ptp(moves)) > 0.0
    if moving and np.corrcoef(goal, moves)[0, 1] < -0.8:
        obstacles.append(
            "position falls where goal_position rises: one of them has the wrong sign. Reverse it."
        )
    if voltages := supply(recording, actuator)[1]:
        said.append(f"The supply voltage is false in {voltages} samples: the usual one counts.")
    moved = smooth(recording, false, first, stop)
    # an error that asks a healthy servo for full duty; an arm that overshoots soon turns round
    full = np.abs(moved.error) * actuator.controller.gain > 1.0
    pace = moved.speed / actuator.motor.no_load_speed
    rests = _lasting(full & (np.abs(pace) < 0.02), 2.0 * _LASTS / interval)
    ends = _lasting(full & (pace * np.sign(moved.error) < -0.3), _LASTS / interval)
    what, why = "lost its torque", "as its overload protection does (trip)"
    if ends is None and rests is not None:
        if _would_move(actuator, recording, first + rests, moved.error[rests]):
            ends, what, why = rests, "stalled", "blocked or without torque (trip)"
        else:
            said.append(
                f"The servo rests far from its goal from {time[first + rests]:.2f} s on: it "
                "stalled, or its gain is low."
            )
    if ends is not None:
        at = f"{time[first + ends]:.2f} s"
        said.append(f"The servo {what} at {at}; what follows is not compared.")
        obstacles.append(
            f"The servo {what} at {at}, {why}. Free its motion or lighten it, and record again."
        )
        stop = first + ends
    if stop - first < _SHORTEST:
        obstacles.append(
            f"Torque was on in {stop - first} samples without a break; at least {_SHORTEST} are "
            "needed. Record a longer motion."
        )
        stop = min(size, first + _SHORTEST)
        first = stop - _SHORTEST
    return Stretch(first, stop, false, said, obstacles)


def with_stated_arm(recording: Recording, actuator: Any) -> Any:
    """The servo with the arm that a recording states."""
    given = recording.channels.items()
    arm = {f"arm.{n}": float(x.mean()) for n, x in given if n in ("mass", "length", "arm_mass")}
    return actuator.with_arrays(arm)


def check_units(recording: Recording, actuator: Any) -> None:
    """Raise `RecordError` where values are in units of registers, not in SI."""
    columns = recording.provenance.get("columns", {})
    travel = float(np.ptp(np.percentile(recording.channels["position"], [1, 99])))
    stated = columns.get("position", {}).get("unit_from", "stated") != "assumed"
    if travel > 4.0 * np.pi and not stated:
        raise RecordError(
            f"{recording.name}: position travels {travel:.4g} rad, {travel / (2 * np.pi):.0f} "
            'turns, and nobody stated its unit. Name degrees as "position [deg]"; for steps of '
            "the encoder give (steps - step where the arm hangs down) * 2 pi / steps of a turn."
        )
    from ematwin.models.position_servo.twin import servo_constants

    load = servo_constants(with_stated_arm(recording, actuator), {}).gravity
    most = 2.0 * actuator.motor.stall_torque  # no servo of the type has more
    if load > most:
        raise RecordError(
            f"{recording.name}: the arm needs {load:.4g} N m by its mass, length and arm_mass, and "
            f"{actuator.name} has no more than {most:.3g} N m. Give kg and m."
        )
    rated, usual = actuator.motor.rated_voltage, float(np.median(supply(recording, actuator)[0]))
    if not rated / 2.5 <= usual <= rated * 2.5:
        raise RecordError(
            f"{recording.name}: supply_voltage is {usual:.4g} V, and {actuator.name} is rated for "
            f"{rated:.4g} V. Registers of servos often hold tenths of a volt; give volts."
        )


def supply(recording: Recording, actuator: Any) -> tuple[np.ndarray, int]:
    """Supply voltage (S,), V, with the usual one for false reads, and their number.

    The rated one where it was not recorded.
    """
    rated = np.full(len(recording), actuator.motor.rated_voltage)
    voltage = recording.channels.get("supply_voltage", rated)
    usual = float(np.median(voltage))
    false = np.abs(voltage - usual) > 0.5 * usual  # on which no servo runs
    return np.where(false, usual, voltage), int(false.sum())


def limited(recording: Recording, actuator: Any) -> np.ndarray:
    """Flags (S,) of samples at which the target of the servo is at its speed limit."""
    controller, goal = actuator.controller, recording.channels["goal_position"]
    late = np.interp(recording.time - controller.delay, recording.time, goal)
    most = controller.speed_limit * recording.interval
    flags, target = np.zeros(goal.size, dtype=bool), float(late[0])
    for n, goes in enumerate(late.tolist()):
        flags[n] = abs(goes - target) > most
        target += min(max(goes - target, -most), most)
    return flags


def rests(position: np.ndarray, play: float, interval: float) -> list[tuple[int, int]]:
    """Stretches (first, stop) in which the mean position over `_LASTS` keeps within ``play``."""
    half = round(0.5 * _LASTS / interval)
    padded = np.pad(position, half, mode="edge")
    mean = np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), mode="valid").tolist()
    found, first, low, high = [], 0, mean[0], mean[0]
    for n, value in enumerate(mean):
        low, high = min(low, value), max(high, value)
        if high - low > play:
            found.append((first, n))
            first, low, high = n, value, value
    return [*found, (first, len(mean))]


def false_reads(position: np.ndarray, most: float) -> np.ndarray:
    """Flags (S,) of samples further than ``most`` (rad) from the median of their neighbours."""
    # of seven samples a false read is one or two; interpolation carries it two samples further
    padded = np.pad(position, 3, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 7)
    odd = np.abs(position - np.median(windows, axis=1)) > max(most, 0.02)
    return np.asarray(np.convolve(odd, np.ones(5), mode="same") > 0.0)


class _Moved(NamedTuple):
    """Motion (S,) of a stretch: position and its error (rad), and speed (rad/s)."""

    position: np.ndarray
    error: np.ndarray
    speed: np.ndarray


def smooth(recording: Recording, false: np.ndarray, first: int, stop: int) -> _Moved:
    """Position, its error and speed with false reads bridged."""
    time, good = recording.time[first:stop], ~false[first:stop]
    if good.sum() < 2 or time.size < _SHORTEST:
        return _Moved(*np.zeros((3, time.size)))
    position = np.interp(time, time[good], recording.channels["position"][first:stop][good])
    error = recording.channels["goal_position"][first:stop] - position
    return _Moved(position, error, np.gradient(position, time))


def _lasting(flags: np.ndarray, least: float) -> int | None:
    """First sample of flags (S,) that stay for ``least`` samples or more."""
    return next((a for a, b in runs(flags) if b - a >= least), None)


def _would_move(actuator: Any, recording: Recording, at: int, error: float) -> bool:
    """Whether a servo with torque would leave a rest, even with the largest single fault.

    An arm that hangs, or has a vertical axis, does not fall where its servo loses the torque.
    """
    from ematwin.models.position_servo.twin import friction, servo_constants
    from ematwin.numerics.compile import plain

    table = {one.name: one for one in unknowns(actuator)}
    worst = {name: table[name].lower for name in ("gain", "torque")}
    worst |= {name: table[name].upper for name in ("friction", "payload")}
    stated = with_stated_arm(recording, actuator)
    for name, value in worst.items():
        c = servo_constants(stated, {name: value})
        linear = c.stall_torque * min(c.gain * abs(error), 1.0)
        load = abs(c.gravity * np.sin(recording.channels["position"][at]) + c.load_torque)
        holds = load + plain(friction)(0.0, load, c)
        if linear / np.hypot(1.0, linear / c.saturation) < holds:
            return False
    return True
