"""How far answers can be trusted on an actuator that nobody knows exactly: docs/trust.md.

    python benchmarks/unknown_actuator.py calibrated --actuators 40 --faulty 5
    python benchmarks/unknown_actuator.py sheet --actuators 20 --faulty 5
    python benchmarks/unknown_actuator.py drift --actuators 12 --faulty 5
    python benchmarks/unknown_actuator.py uncalibrated --actuators 40 --faulty 3
    python benchmarks/unknown_actuator.py evidence --actuators 8 --faulty 6
    python benchmarks/unknown_actuator.py sensors --actuators 12 --faulty 4
    python benchmarks/unknown_actuator.py zeros --actuators 12 --faulty 4
    python benchmarks/unknown_actuator.py structure --actuators 12 --faulty 6
    python benchmarks/unknown_actuator.py loops --actuators 12 --faulty 6
    python benchmarks/unknown_actuator.py forms --actuators 12
    python benchmarks/unknown_actuator.py special

Recordings have 2 % white noise and 12 bits. ``calibrated``: all parameters of the actuator are a
few per cent off the template, which learns from three healthy recordings. ``sheet``: only what a
data sheet states is right, ten values are off by up to a third. ``drift``: after calibration the
torque constant falls by 3 %, the resistance rises by 30 %, the supply falls by 5 %, the load is off
by 10 % and the command is 200 us late, one of them or all. ``uncalibrated``: the template is
trusted as far as its tolerances go. ``evidence``: calibrated and judged with phase voltages, with
the supply's current, and with neither; the sensors of the phases drift by 2 % in every other
recording. ``sensors``: calibrated and judged with a sensor in each phase that has a gain (1 %) and
an offset (0.2 A) of its own, which in every other recording are others than when the actuator was
calibrated; and the same of two sensors, the third current being made of the others; and by a data
sheet alone. ``zeros``: the rotor stands anywhere where the command is zero; calibrated and by a
data sheet, with positions from sensors that are mounted 5 degrees electrical (motor) and 0.05 rad
of the motor shaft (output) off, standard deviations; and with command, load and phase currents
alone. ``structure``: recordings of a simulator that shares no code with the twin and has what
the twin lacks (tests/naive/another_actuator.py). ``loops``: those of them with a PI current
loop, judged by a twin whose file says how the loops of the drive are set. ``forms``: an offset
that is fixed in space, and a short that is a loop, judged by a data sheet that has neither form
(docs/models.md, "Truer forms").
``special``: motions and recordings from which nothing can be told.

Each prints a Markdown table; ``--json FILE`` writes the runs.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from counted import MAGNITUDES, NOISE, holds, silently_wrong
from ematwin import Noise, identify, simulate
from ematwin.errors import EmatwinError
from ematwin.estimation.learn import learn
from ematwin.models.bldc.channels import PHASES, VOLTAGES
from ematwin.models.bldc.faults import FAULTS, HEALTHY, error_percent_wrapped
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario, Step
from ematwin.recordings.recording import Recording

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

SHEET = load_actuator("servo48")
VOLTAGE_NOISE, VOLTAGE_STEP = 0.5, 0.03  # V: 1 % of the supply, 12 bits of +-60 V
VOLTAGE_GAIN = 0.005  # standard deviation of a rig's voltages, or of its supply's current
CURRENT_DRIFT = 0.02  # by which the sensors of the phases change in every other recording
PHASE_GAIN, PHASE_OFFSET = 0.01, 0.2  # A; standard deviations of the sensor of each phase
MOTOR_ZERO, OUTPUT_ZERO = np.radians(5.0), 0.05  # electrical; rad, motor shaft; of their sensors
HEALTHY_RECORDINGS = 3

# Standard deviations, of logarithms, with which the actuators of ``calibrated`` are off the sheet.
OFF = {
    "motor.resistance": 0.05, "motor.inductance": 0.1, "motor.emf_constant": 0.03,
    "motor.inertia": 0.06, "motor.viscous_damping": 0.2, "motor.friction_torque": 0.1,
    "transmission.friction_torque": 0.1, "transmission.output_inertia": 0.12,
    "transmission.backlash": 0.15, "controller.position_gain": 0.04,
    "controller.speed_gain": 0.04, "transmission.static_ratio": 0.08,
    "drive.supply_voltage": 0.02,
}  # fmt: skip
# What no data sheet states: off by up to a third.
SILENT = (
    "motor.viscous_damping", "motor.friction_torque", "transmission.friction_torque",
    "transmission.output_inertia", "transmission.backlash", "controller.position_gain",
    "controller.speed_gain", "transmission.static_ratio",
)  # fmt: skip
EFFICIENCIES = ("transmission.efficiency_opposing", "transmission.efficiency_aiding")
DRIFTS: dict[str, dict[str, float]] = {
    "torque constant": {"motor.emf_constant": 0.97},
    "resistance": {"motor.resistance": 1.3},
    "supply": {"drive.supply_voltage": 0.95},
    "load": {"load": 1.1},
    "skew": {"skew": 200e-6},
}
ALL_DRIFTS = {name: x for part in DRIFTS.values() for name, x in part.items()}
CASES: tuple[dict[str, float], ...] = (
    {},
    {"friction": 0.25, "short_b": 0.15},
    {"eccentricity": 0.4, "eccentricity_phase": 0.3, "backlash": 0.3},
)


@dataclass(frozen=True)
class Outcome:
    """One judged recording."""

    group: str
    injected: dict[str, float]
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    grade: str
    faults: tuple[str, ...]
    reason: str
    error: float
    physical_error: float
    misfit: float


def actuator_off(seed: int) -> BldcActuator:
    """An actuator whose parameters are a few per cent off the data sheet."""
    rng = np.random.default_rng([1, seed])
    values = {
        place: SHEET.value(place) * float(np.exp(spread * np.clip(rng.standard_normal(), -2, 2)))
        for place, spread in OFF.items()
    }
    for place in EFFICIENCIES:
        values[place] = min(0.99, SHEET.value(place) * (1.0 + 0.02 * rng.uniform(-1, 1)))
    return SHEET.changed(values)


def actuator_of_sheet(seed: int) -> BldcActuator:
    """An actuator of which the data sheet states what it states rightly, and nothing else."""
    rng = np.random.default_rng([2, seed])
    values = {p: SHEET.value(p) * float(1.0 + rng.uniform(-1 / 3, 1 / 3)) for p in SILENT}
    for place in EFFICIENCIES:
        values[place] = 1.0 - (1.0 - SHEET.value(place)) * float(1.0 + rng.uniform(-1 / 3, 1 / 3))
    return SHEET.changed(values)


def injected_faults(rng: np.random.Generator) -> dict[str, float]:
    """None to three faults, none so small that it would not matter."""
    found: dict[str, float] = {}
    for name in rng.choice(MAGNITUDES, rng.integers(0, 4), replace=False).tolist():
        if name == "gain":
            found[name] = float(0.5 + rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.3))
        else:
            found[name] = float(rng.uniform(0.03, 0.6))
        if name == "eccentricity":
            found["eccentricity_phase"] = float(rng.random())
    return found


def cases(count: int, seed: int) -> list[dict[str, float]]:
    """Three given vectors, then random ones."""
    rng = np.random.default_rng([3, seed])
    return [dict(CASES[n]) if n < len(CASES) else injected_faults(rng) for n in range(count)]


def recorded(
    actuator: BldcActuator,
    faults: Mapping[str, float],
    seed: int,
    drift: Mapping[str, float],
    also: Sequence[str] = (),
) -> Recording:
    """A recording of the reference model; ``drift`` as in `DRIFTS`, further channels ``also``."""
    changed = {place: actuator.value(place) * x for place, x in drift.items() if "." in place}
    found = simulate(
        "reference", faults=faults, actuator=actuator.changed(changed) if changed else actuator,
        noise=NOISE, seed=seed, also=also,
    )  # fmt: skip
    more = {}
    rng = np.random.default_rng([5, seed])
    for name in (one for one in VOLTAGES if one in also):
        volts = found.channels[name] + VOLTAGE_NOISE * rng.standard_normal(len(found))
        more[name] = np.round(volts / VOLTAGE_STEP) * VOLTAGE_STEP
    if "volts" in drift:
        more |= {n: drift["volts"] * more.get(n, found.channels[n]) for n in also}
    if "amperes" in drift:
        more |= {name: drift["amperes"] * found.channels[name] for name in PHASES}
    if "load" in drift:  # the sensor shows less than there is
        more["load"] = found.channels["load"] / drift["load"]
    if "skew" in drift:
        t = found.time
        more["command"] = np.interp(t - drift["skew"], t, found.channels["command"])
    return found.changed(**more) if more else found


def judged(
    group: str, record: Recording, known: Any, true: BldcActuator, faults: Mapping[str, float]
) -> Outcome:
    """Identify a recording and set the answer beside the truth."""
    found = identify(record, known, threads=1)
    injected = {**dict(zip(FAULTS, HEALTHY.tolist(), strict=True)), **faults}
    values = {name: found.values[name] for name in FAULTS}
    physical = {row.name: row.value for row in found.physical}
    torque = true.motor.friction_torque + true.transmission.friction_torque
    in_units = {
        **values,
        "friction": (physical["friction"] / torque - 1.0) / 2.0,
        "backlash": (physical["backlash"] / true.transmission.backlash - 1.0) / 99.0,
        "gain": physical["gain"] / true.controller.position_gain - 0.5,
    }
    truth = np.array([injected[name] for name in FAULTS])
    error, physical_error = (
        float(error_percent_wrapped(np.array([v[name] for name in FAULTS]), truth))
        for v in (values, in_units)
    )
    return Outcome(
        group, injected, values, {n: found.intervals[n] for n in FAULTS}, found.verdict.grade,
        found.verdict.faults, found.verdict.reason, error, physical_error, found.relative_misfit,
    )  # fmt: skip


def learnt(recordings: Sequence[Recording], template: BldcActuator) -> Any:
    """What healthy recordings say of an actuator."""
    model = model_of(template)
    return learn(model, template, [model.compare(r, template, threads=1) for r in recordings])


def of_actuator(mode: str, seed: int, faulty: int) -> list[Outcome]:
    """All judged recordings of one actuator."""
    true = actuator_of_sheet(seed) if mode == "sheet" else actuator_off(seed)
    known: Any = SHEET
    if mode != "uncalibrated":
        healthy = [recorded(true, {}, 10 + n, {}) for n in range(HEALTHY_RECORDINGS)]
        known = learnt(healthy, SHEET)
    found = []
    for n, faults in enumerate(cases(faulty, seed)):
        group, drift = mode, {}
        if mode == "drift":
            names = [*DRIFTS, "all"]
            group = names[(seed + n) % len(names)]
            drift = ALL_DRIFTS if group == "all" else DRIFTS[group]
        record = recorded(true, faults, 100 + n, drift)
        found.append(judged(group, record, known, true, faults))
    return found


EVIDENCE = {"phase voltages": VOLTAGES, "supply's current": ("bus_current",), "currents alone": ()}


def of_evidence(seed: int, faulty: int) -> list[Outcome]:
    """The same recordings with and without voltages; every other with a sensor that drifted."""
    true = actuator_off(seed)
    rng = np.random.default_rng([6, seed])
    rig = {"volts": 1.0 + VOLTAGE_GAIN * rng.standard_normal()}
    drifts = [1.0 + CURRENT_DRIFT * rng.choice([-1.0, 1.0]) * (n % 2) for n in range(faulty)]
    found = []
    for title, also in EVIDENCE.items():
        healthy = [recorded(true, {}, 10 + n, rig, also) for n in range(HEALTHY_RECORDINGS)]
        known = learnt(healthy, SHEET)
        for n, faults in enumerate(cases(faulty, seed)):
            record = recorded(true, faults, 100 + n, {**rig, "amperes": drifts[n]}, also)
            group = f"{title}, sensor drifted" if n % 2 else title
            found.append(judged(group, record, known, true, faults))
    return found


def shown(record: Recording, gains: np.ndarray, offsets: np.ndarray, two: bool) -> Recording:
    """The recording as sensors of the phases show it, each with a gain and an offset (A)."""
    each = zip(PHASES, gains, offsets, strict=True)
    seen = {name: gain * record.channels[name] + offset for name, gain, offset in each}
    if two:
        seen[PHASES[2]] = -(seen[PHASES[0]] + seen[PHASES[1]])
    return record.changed(**seen)


def of_sensors(seed: int, faulty: int) -> list[Outcome]:
    """The same recordings through sensors that differ from phase to phase."""
    true = actuator_off(seed)
    rng = np.random.default_rng([8, seed])
    errors = [
        (1.0 + PHASE_GAIN * rng.standard_normal(3), PHASE_OFFSET * rng.standard_normal(3))
        for _ in range(1 + faulty)
    ]
    healthy = [recorded(true, {}, 10 + n, {}) for n in range(HEALTHY_RECORDINGS)]
    faults = cases(faulty, seed)
    records = [recorded(true, one, 100 + n, {}) for n, one in enumerate(faults)]
    found = []
    for title, two in (("three sensors", False), ("two sensors", True), ("data sheet", False)):
        known: Any = SHEET
        if title != "data sheet":
            known = learnt([shown(one, *errors[0], two) for one in healthy], SHEET)
        for n, record in enumerate(records):
            drifted = n % 2 == 1 and title != "data sheet"
            group = f"{title}, drifted" if drifted else title
            seen = shown(record, *errors[1 + n if drifted else 0], two)
            found.append(judged(group, seen, known, true, faults[n]))
    return found


def recorded_at(
    actuator: BldcActuator, faults: Mapping[str, float], seed: int, angle: float
) -> Recording:
    """A recording of the reference model whose rotor stands at an electrical angle (rad).

    The motion is the default's; the motor's position is counted from phase a, that of the output
    and the command from where it starts.
    """
    zero = angle / actuator.motor.pole_pairs / actuator.transmission.ratio
    scenario = model_of(actuator).load_scenario(None)
    command = [*scenario.command, Step(value=zero)]
    found = simulate(
        "reference", Scenario(duration=scenario.duration, command=command, load=scenario.load),
        faults, actuator, noise=NOISE, seed=seed, initial_position=zero,
    )  # fmt: skip
    names = ("command", "output_position")
    return found.changed(**{name: found.channels[name] - zero for name in names})


def of_zeros(seed: int, faulty: int) -> list[Outcome]:
    """The same recordings with positions from sensors of any zero, and without."""
    true = actuator_off(seed)
    rng = np.random.default_rng([9, seed])
    angle = rng.uniform(-np.pi, np.pi)
    motor = MOTOR_ZERO * rng.standard_normal() / true.motor.pole_pairs
    output = OUTPUT_ZERO * rng.standard_normal() / true.transmission.ratio

    def mounted(record: Recording) -> Recording:
        more = {name: record.channels[name] + output for name in ("command", "output_position")}
        return record.changed(motor_position=record.channels["motor_position"] + motor, **more)

    def without(record: Recording) -> Recording:
        left = {name: record.channels[name] for name in ("command", "load", *PHASES)}
        return Recording(record.time, left, units={name: record.units[name] for name in left})

    faults = cases(faulty, seed)
    healthy = [recorded_at(true, {}, 10 + n, angle) for n in range(HEALTHY_RECORDINGS)]
    records = [recorded_at(true, one, 100 + n, angle) for n, one in enumerate(faults)]
    found = []
    for title, seen in (("positions", mounted), ("no positions", without)):
        known = learnt([seen(one) for one in healthy], SHEET)
        for group, template in ((title, known), (f"data sheet, {title}", SHEET)):
            found += [
                judged(group, seen(record), template, true, one)
                for record, one in zip(records, faults, strict=True)
            ]
    return found


def of_structure(seed: int, faulty: int, known_loops: bool = False) -> list[Outcome]:
    """The same with the other simulator.

    With ``known_loops`` only those of a PI current loop, and the parameter file says how the drive
    is set: gains, sample times and delay of its current loop, sample time of its speed loop.
    The voltage that its switches take stays unknown.
    """
    from naive import another_actuator as other

    true = actuator_of_sheet(seed)
    structure = other.Structure.random(np.random.default_rng([4, seed]))
    group = ("with PI current loop", "PI loop without delay", "ideal current loop")[seed % 3]
    if group == "PI loop without delay":
        interval = min(structure.control_interval, 1e-4)
        structure = structure._replace(current_delay=0, control_interval=interval)
    if group == "ideal current loop":
        structure = structure._replace(current_interval=0.0, control_interval=0.0)
    gain, parameters = "controller.speed_gain", other.parameters_of(true)
    template = SHEET
    if group != "PI loop without delay":
        parameters = other.tuned(parameters, structure)
        own = other.tuned(other.parameters_of(SHEET), structure)[gain]
        template = SHEET.changed({gain: own})
    if known_loops:
        if structure.current_interval == 0.0:
            return []
        bandwidth, interval = structure.current_bandwidth, structure.current_interval
        group += ", loops known"
        template = template.changed({
            "current_loop.proportional_gain": bandwidth * parameters["motor.inductance"],
            "current_loop.integral_gain": bandwidth * parameters["motor.resistance"],
            "current_loop.sample_time": interval,
            "current_loop.delay": structure.current_delay * interval,
            "current_loop.lost_voltage": 1.0,  # nobody knows it; up to 3 V here
            "speed_loop.integral_gain": 0.0,
            "speed_loop.sample_time": structure.control_interval,
            "speed_loop.delay": 0.0,
        })  # fmt: skip
    scenario = model_of(SHEET).load_scenario(None)
    time = np.arange(10_001) / 20_000.0
    command, load = scenario.histories(time)

    def record(faults: Mapping[str, float], number: int) -> Recording:
        return other.simulate(parameters, time, command, load, dict(faults), structure, seed=number)

    known = learnt([record({}, 10 + n) for n in range(HEALTHY_RECORDINGS)], template)
    return [
        judged(group, record(faults, 100 + n), known, true, faults)
        for n, faults in enumerate(cases(faulty, seed))
    ]


def of_forms(seed: int, faulty: int) -> list[Outcome]:
    """Faults of forms that the twin does not have, judged by the data sheet."""
    true = actuator_off(seed)
    rng = np.random.default_rng([7, seed])
    offset = {"eccentricity": rng.uniform(0.05, 0.4), "eccentricity_phase": rng.random()}
    short = {f"short_{'abc'[seed % 3]}": rng.uniform(0.05, 0.3)}
    contact = float(np.exp(rng.uniform(np.log(0.02), np.log(0.5))))
    forms = (
        ("offset fixed in space", {"eccentricity.turning_share": 0.0}, offset),
        ("short with its loop", {"shorted_turns.resistance": contact}, short),
    )
    return [
        judged(title, recorded(true.changed(form), faults, 100, {}), SHEET, true, faults)
        for title, form, faults in forms
    ]


SPECIAL = {"friction": 0.25, "short_b": 0.15}


def special_recordings(true: BldcActuator) -> dict[str, Recording]:
    """Recordings from which nothing, or not everything, can be told."""
    faults = SPECIAL
    usual = recorded(true, faults, 100, {})

    def chirp(amplitude: float) -> Recording:
        parts = [{"type": "chirp", "amplitude": amplitude, "f_start": 5.0, "f_end": 25.0}]
        scenario = Scenario(duration=0.5, command=parts)
        return simulate("reference", scenario, faults, true, noise=NOISE, seed=100)

    in_degrees = usual.changed(command=np.degrees(usual.channels["command"]))
    clipped = usual.changed(**{k: np.clip(usual.channels[k], -1.5, 1.5) for k in PHASES})
    coarse = simulate(
        "reference", faults=faults, actuator=true, noise=Noise(white=0.02, bits=10), seed=100
    )
    return {
        "motion of 20 urad": chirp(20e-6),
        "motion of 200 urad": chirp(200e-6),
        "no load column": usual.changed(load=None),
        "degrees for radians": in_degrees,
        "saturated currents": clipped,
        "ten bits": coarse,
    }


def special(true: BldcActuator, known: Any) -> list[Outcome]:
    """Those recordings, judged by what usual ones say of the actuator."""
    found = []
    for name, record in special_recordings(true).items():
        try:
            found.append(judged(name, record, known, true, SPECIAL))
        except EmatwinError as refusal:
            print(f"{name}: refused: {refusal}")
    return found


def is_silently_wrong(one: Outcome) -> bool:
    """Whether a verdict is wrong, and nothing said."""
    return silently_wrong(one.grade, one.values, one.intervals, one.injected)


def injected_names(one: Outcome) -> set[str]:
    """Names of the injected faults."""
    healthy = dict(zip(FAULTS, HEALTHY.tolist(), strict=True))
    return {name for name in MAGNITUDES if abs(one.injected[name] - healthy[name]) >= 0.02}


def in_deviations(one: Outcome, name: str) -> float:
    """The error of a value by the standard deviation that its interval states."""
    low, high = one.intervals[name]
    return 1.96 * (one.values[name] - one.injected[name]) / max(0.5 * (high - low), 1e-12)


def row(title: str, runs: Sequence[Outcome]) -> str:
    """A line of the table."""

    def inside(one: Outcome, name: str) -> bool:
        return holds(one.intervals[name], one.injected[name])

    verdicts = [one for one in runs if one.grade != "none"]
    held = [inside(one, name) for one in verdicts or runs for name in MAGNITUDES]
    # the interval of a fault that is absent reaches to healthy, and holds nearly always
    there = [(one, name) for one in verdicts or runs for name in sorted(injected_names(one))]
    off = [in_deviations(*each) for each in there]
    healthy = [one for one in runs if not injected_names(one)]
    faulty = [one for one in verdicts if injected_names(one)]
    named = [injected_names(one) <= set(one.faults) for one in faulty]
    extra = [bool(set(one.faults) - injected_names(one)) for one in runs]
    errors = [one.error for one in runs]
    physical = [one.physical_error for one in runs]

    def share(values: Sequence[bool]) -> str:
        return f"{100.0 * sum(values) / len(values):.1f}" if values else "-"

    return (
        f"| {title} | {len(runs)} | {np.median(errors):.2f} / {np.quantile(errors, 0.9):.2f} | "
        f"{np.median(physical):.2f} / {np.quantile(physical, 0.9):.2f} | {share(held)} | "
        f"{share([inside(*each) for each in there])} of {len(there)}, "
        f"{np.sqrt(np.mean(np.square(off))) if off else math.nan:.2f} | "
        f"{share([is_silently_wrong(one) for one in runs])} | "
        f"{share([one.grade == 'fault' for one in healthy])} of {len(healthy)} | {share(named)} | "
        f"{share(extra)} | {share([one.grade == 'none' for one in runs])} |"
    )


COLUMNS = (
    "recordings", "Err%, median / P90", "in N m, rad, 1/s", "intervals that hold, %",
    "of faults that are there, %, error over standard deviation", "silently wrong, %",
    "healthy called faulty, %", "all faults named, %", "a wrong one named, %", "no verdict, %",
)  # fmt: skip
HEADER = f"| | {' | '.join(COLUMNS)} |\n|---|{'--:|' * len(COLUMNS)}"

KNOWN = ("calibrated", "sheet", "drift", "uncalibrated")  # by what is known of the actuator
BY_MODE: dict[str, Callable[[int, int], list[Outcome]]] = {
    **{mode: partial(of_actuator, mode) for mode in KNOWN},
    "evidence": of_evidence, "sensors": of_sensors, "zeros": of_zeros, "structure": of_structure,
    "loops": partial(of_structure, known_loops=True), "forms": of_forms,
}  # fmt: skip


def unless_refused(of: Any, seed: int, faulty: int) -> list[Outcome]:
    """Those of an actuator; none, and why, where it is refused: unstable, or not as its sheet."""
    try:
        return of(seed, faulty)
    except EmatwinError as refusal:
        print(f"actuator {seed} is refused: {refusal}", file=sys.stderr)
        return []


def main() -> None:
    """Run one part of the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("mode", choices=(*BY_MODE, "special"))
    parser.add_argument("--actuators", type=int, default=10)
    parser.add_argument("--faulty", type=int, default=5, help="recordings of each actuator")
    parser.add_argument("--first", type=int, default=0, help="seed of the first actuator")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, help="write the runs here")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.actuators)
    if given.mode == "special":
        true = actuator_off(given.first)
        healthy = [recorded(true, {}, 10 + n, {}) for n in range(HEALTHY_RECORDINGS)]
        parts = [special(true, learnt(healthy, SHEET))]
    else:
        of = BY_MODE[given.mode]
        parts = Parallel(given.workers)(delayed(unless_refused)(of, s, given.faulty) for s in seeds)
    runs = [one for part in parts for one in part]
    if given.json is not None:
        given.json.write_text(json.dumps([vars(one) for one in runs], indent=1), encoding="utf-8")
    print(HEADER)
    groups = dict.fromkeys(one.group for one in runs)
    if len(groups) > 1:
        for group in groups:
            print(row(group, [one for one in runs if one.group == group]))
    if given.mode not in ("special", "evidence", "sensors", "zeros", "forms"):
        print(row(given.mode, runs))
    if given.mode == "forms":
        wrong = [one for one in runs if set(one.faults) - injected_names(one)]
        told = sum("Not certain:" in one.reason for one in wrong)
        print(f"\nOf {len(wrong)} that name a wrong fault, {told} say what else it may be.")
    for one in runs if given.mode == "special" else ():
        print(f"\n{one.group}: {one.grade} {', '.join(one.faults)}. {one.reason}")


if __name__ == "__main__":
    main()
