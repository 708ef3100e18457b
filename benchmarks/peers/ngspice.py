"""The same electrics in ngspice: seconds of work per simulated second.

ngspice has the bridge (six switches with diodes), three R-L branches with back-EMF, a free star
point, commutation and the hysteresis regulator; rotor angle, speed and current reference are those
of a recording of ematwin's reference model, played back. ematwin's figure is of all of that model,
controller and mechanics included, at its step of 1 us; ngspice chooses its steps, 1 us at most.

Before ngspice is timed, its equivalent current behind a 500 Hz low-pass must be that of the
recording within 3 % of RMS. 1.9 % were seen in 20 ms, and 1.3 % with a reference model of 0.25 us:
its comparator acts once a step, that of ngspice at any time, and the current is small beside the
hysteresis band.
"""

import math
import tempfile
from pathlib import Path

import numpy as np
from benchmarks.peers.measure import Line, Part, in_turn, program_version, progress

from ematwin import Faults, simulate
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.signals import LowPass
from ematwin.recordings.recording import Recording
from ngspice import answer_of, bridge, straight

FAULTS = Faults(short_a=0.3, eccentricity=0.3, eccentricity_phase=0.3)
START, LENGTH = 0.30, 0.05  # s, of the default scenario
SETTLED = 0.005  # s, after which currents are compared
LIMIT = 0.03  # of RMS


def played_back(name: str, time: np.ndarray, values: np.ndarray) -> str:
    """A voltage source of straight lines between samples."""
    pairs = zip(time - time[0], values, strict=True)
    return straight(name, [f"{t:.9g} {v:.9g}" for t, v in pairs])


def current_reference(record: Recording, actuator: BldcActuator) -> np.ndarray:
    """(S,) array, A: what position and speed loop ask for."""
    control, ratio = actuator.controller, actuator.transmission.ratio
    gain = control.position_gain * (0.5 + FAULTS.gain)
    w_ref = gain * ratio * (record.command - record.output_position)
    w_ref = np.clip(w_ref, -control.speed_limit, control.speed_limit)
    i_ref = control.speed_gain * (w_ref - record.motor_speed) / actuator.motor.emf_constant
    return np.clip(i_ref, -actuator.drive.current_limit, actuator.drive.current_limit)


def circuit_of(record: Recording, actuator: BldcActuator) -> list[str]:
    """The circuit; parameters of the actuator are phase to phase."""
    motor, drive = actuator.motor, actuator.drive
    first = np.stack([record.current_a, record.current_b, record.current_c])[:, 0]
    largest = "max(abs(i(Vsa)),max(abs(i(Vsb)),abs(i(Vsc))))"
    along = "+".join(f"v(d{x})*i(Vs{x})" for x in "abc")
    lines = [
        "three-phase bridge with commutation and hysteresis regulator",
        *bridge(drive),
        f".model comparator SW(vt=0 vh={drive.hysteresis_band / 2.0} ron=1 roff=1e9)",
        played_back("angle", record.time, record.motor_position),
        played_back("speed", record.time, record.motor_speed),
        played_back("wanted", record.time, current_reference(record, actuator)),
        f"Bseen seen 0 V=sgn({along})*{largest}",
        "Vone one 0 1",
        "Sregulator one sign wanted seen comparator",
        "Rsign sign 0 1k",
    ]
    shorts = (FAULTS.short_a, FAULTS.short_b, FAULTS.short_c)
    for n, (x, short) in enumerate(zip("abc", shorts, strict=True)):
        h, lag = 1.0 - short, 2.0 * math.pi * n / 3.0
        leak = motor.leakage_share
        inductance = (h**2 * (1.0 - leak) + leak) * motor.inductance / 2.0
        phi = 2.0 * math.pi * (FAULTS.eccentricity_phase - 0.5)
        gap = f"(1+{FAULTS.eccentricity}*cos(v(angle)+{phi - lag:.12g}))"
        # a triangle; above 1 and below -1 the leg is driven, between it is off
        shape = f"{6.0 / math.pi:.12g}*asin(sin({motor.pole_pairs}*v(angle)-{lag:.12g}))"
        emf = f"{h * motor.emf_constant / 2.0:.12g}*v(speed)*{gap}*max(-1,min(1,v(f{x})))"
        lines += [
            f"Bf{x} f{x} 0 V={shape}",
            f"Bd{x} d{x} 0 V=v(f{x})>1 ? 1 : (v(f{x})<-1 ? -1 : 0)",
            f"Bh{x} h{x} 0 V=v(d{x})*(v(sign)-0.5)>0.1 ? 1 : 0",
            f"Bl{x} l{x} 0 V=v(d{x})*(v(sign)-0.5)<-0.1 ? 1 : 0",
            f"Vs{x} t{x} s{x} 0",
            f"R{x} s{x} r{x} {h * motor.resistance / 2.0:.12g}",
            f"L{x} r{x} e{x} {inductance:.12g} IC={first[n]:.9g}",
            f"B{x} e{x} star V={emf}",
        ]
    return lines


def run_ngspice(record: Recording, actuator: BldcActuator, duration: float) -> np.ndarray:
    """Time and phase currents, (N, 4)."""
    with tempfile.TemporaryDirectory() as folder:
        return answer_of(
            circuit_of(record, actuator), ("i(La)", "i(Lb)", "i(Lc)"), duration, Path(folder),
            tolerance=1e-3,
        )  # fmt: skip


def disagreement(seen: np.ndarray, record: Recording) -> float:
    """RMS difference of the equivalent currents behind the low-pass, as a share of RMS."""
    time = record.time - record.time[0]
    time = time[time <= seen[-1, 0] + 1e-9]
    widths = np.diff(seen[:, 0])
    means = []
    for n in (1, 2, 3):  # a recorded current is the mean over the interval that ends at its sample
        charge = np.r_[0.0, np.cumsum(0.5 * widths * (seen[1:, n] + seen[:-1, n]))]
        means.append(np.diff(np.interp(time, seen[:, 0], charge)) / record.interval)
    recorded = [record.current_a, record.current_b, record.current_c]
    other, own = (
        LowPass().apply(0.5 * np.abs(np.stack(three)).sum(axis=0), record.sample_rate)
        for three in (means, [current[1 : time.size] for current in recorded])
    )
    kept = time[1:] >= SETTLED
    return float(np.sqrt(np.mean((other - own)[kept] ** 2) / np.mean(own[kept] ** 2)))


def run(*, quick: bool, repeats: int) -> Part:
    """Check and time ngspice beside the reference model."""
    actuator = BldcActuator.load()
    progress("ngspice: ematwin's recording")
    whole = simulate("reference", faults=FAULTS, actuator=actuator)
    length = 0.02 if quick else LENGTH
    record = whole.between(START, START + length + 1e-3)
    simulated = float(whole.time[-1])

    def own() -> object:
        return simulate("reference", faults=FAULTS, actuator=actuator)

    own()
    remarks, versions = [], program_version("ngspice")
    lines: list[Line] = []
    pairs: list[tuple[float, float]] = []
    if not versions:
        remarks.append(
            "ngspice is left out: it is not installed (Debian: apt-get install ngspice)."
        )
    else:
        progress("ngspice: comparing currents")
        off = disagreement(run_ngspice(record, actuator, length), record)
        if off <= LIMIT:
            progress("ngspice: timing")
            pairs = in_turn(lambda: run_ngspice(record, actuator, length), own, repeats, 60.0)
            values = tuple(peer / length for peer, _ in pairs)
            ratios = tuple((peer / length) / (mine / simulated) for peer, mine in pairs)
            lines.append(Line("ngspice, electrics", values, ratios, (f"{100.0 * off:.2f} %",)))
        else:
            lines.append(Line("ngspice, electrics", (), (), (f"{100.0 * off:.2f} %",)))
            remarks.append(
                f"ngspice is not timed: its current is {100.0 * off:.1f} % of RMS away; "
                f"{100.0 * LIMIT:g} % is allowed."
            )
    pairs = pairs or in_turn(own, own, repeats, 60.0)
    values = tuple(mine / simulated for _, mine in pairs)
    mine = Line(
        "ematwin, reference model", values, tuple(1.0 for _ in values), ("",), own=True
    )  # fmt: skip
    return Part(
        "The electrics in a circuit simulator",
        f"Seconds of work per simulated second: {length:g} s of bridge, phases, commutation "
        "and hysteresis regulator in ngspice, with motion and current reference played back; all "
        "of the reference model in ematwin. ngspice's time includes the start of its process.",
        "s a simulated second",
        "times ematwin",
        ("difference of filtered currents",),
        (mine, *lines),
        tuple(remarks),
        versions,
    )
