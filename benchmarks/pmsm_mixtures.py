"""Mixtures of up to five faults of a PMSM servo: error, verdict, intervals, time.

    python benchmarks/pmsm_mixtures.py [--count 50] [--first 0] [--sheet | --calibrated 4]
                                       [--without-voltages | --measured-voltages] [--out FILE]

The recordings are of the reference model (5 us, quantised sensors), with white noise of 2 % of the
RMS and converters of 12 bits on phase currents and voltages, those that the drive commands or, with
``--measured-voltages``, those at the terminals; the twin is told the parameters, not the faults.
With ``--sheet`` each actuator is off its data sheet, within its tolerances, and the twin is told
the sheet. With ``--calibrated`` so many actuators are off their sheet, and have cogging, harmonics
of the EMF and presliding friction that it does not state; each is calibrated on two healthy
recordings, and judged on ``--count`` mixtures. Of a calibration: errors of the parameters over
their stated deviations, each for itself and jointly, root mean square; 1 is right.

Of each: Err% (the norm of the differences of the normalised magnitudes, in per cent; a direction
counts by its magnitude), the grade of the verdict, how many of the 95 % intervals hold what was
injected, and whether a verdict is silently wrong: a fault of 5 % or more is not mentioned, one is
named that is not there, or a value lies outside its interval by half of its half width and 0.01,
and nothing is said.
"""

import argparse
import csv
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ematwin import Noise, calibrate, identify, simulate
from ematwin.estimation.prior import coordinate
from ematwin.models.pmsm.channels import TERMINALS
from ematwin.models.registry import load_actuator, model_of

NOISE, BITS = 0.02, 12
MOST = 5  # faults
LARGE = 0.05  # share of the range from which a fault should be named
SMALL = 0.02  # below which none should be
SEVERITY = (0.1, 0.8)  # share of the way to a bound


@dataclass(frozen=True)
class Row:
    """What came out for one mixture."""

    seed: int
    injected: str
    error: float
    grade: str
    missed: str
    invented: str
    outside: str
    held: int
    intervals: int
    seconds: float
    misfit: float

    @property
    def silently_wrong(self):
        return self.grade != "none" and bool(self.missed or self.invented or self.outside)


def mixture(model, actuator, seed):
    """One to five faults, at most one of them a short; directions at random."""
    random = np.random.default_rng(seed)
    groups = {}
    for one in model.faults(actuator):
        if one.direction_of is None:
            group = "short" if one.name.startswith("short") else one.name
            groups.setdefault(group, []).append(one)
    names = random.choice(sorted(groups), size=random.integers(1, MOST + 1), replace=False)
    values = {}
    for name in names:
        one = groups[name][random.integers(len(groups[name]))]
        ends = [end for end in (one.lower, one.upper) if end != one.healthy]
        end = ends[random.integers(len(ends))]
        values[one.name] = float(one.healthy + random.uniform(*SEVERITY) * (end - one.healthy))
    for one in model.faults(actuator):
        if one.direction_of in values:
            values[one.name] = float(random.random())
    return values


COMMANDED = ("voltage_a", "voltage_b", "voltage_c")


def measured(recording, actuator, seed, voltages):
    """A simulation as converters would have given it, with some of its voltages."""
    seen = Noise(white=NOISE, bits=BITS, full_scale=actuator.drive.current_range).apply(
        recording, np.random.default_rng(seed)
    )
    random = np.random.default_rng(10_000 + seed)
    step = 2.0 * actuator.drive.supply_voltage / 2**BITS
    changed = dict.fromkeys(COMMANDED)
    for name in voltages:
        volts = seen.channels[name]
        noise = NOISE * np.sqrt(np.mean(volts**2)) * random.standard_normal(volts.size)
        changed[name] = step * np.round((volts + noise) / step)
    return seen.changed(**changed)


def off_sheet(actuator, seed):
    """An actuator of which the sheet is true within its tolerances."""
    random = np.random.default_rng(50_000 + seed)
    spread = {place: actuator.tolerance(place) for place, *_ in actuator.parameters()}
    return actuator.changed(
        {
            place: actuator.value(place)
            * np.exp(0.5 * np.log1p(one) * np.clip(random.normal(), -2, 2))
            for place, one in spread.items()
            if one is not None and actuator.value(place) > 0.0
        }
    )


def as_built(actuator, seed):
    """The same with forms that the sheet does not state."""
    random = np.random.default_rng(60_000 + seed)
    return off_sheet(actuator, seed).changed({
        "motor.cogging_torque": random.uniform(0.005, 0.03),
        "motor.cogging_periods": int(random.choice((10, 12, 60))),
        "motor.cogging_phase": random.uniform(-np.pi, np.pi),
        "motor.harmonic_5": random.uniform(-0.05, 0.05),
        "motor.harmonic_7": random.uniform(-0.025, 0.025),
        "presliding.motor_stiffness": random.uniform(10.0, 60.0),
        "presliding.output_stiffness": random.uniform(10.0, 60.0),
        "presliding.damping": random.uniform(0.005, 0.02),
    })  # fmt: skip


def calibrated(actuator, seed):
    """An actuator as it is built, and its calibration."""
    true = as_built(actuator, seed)
    healthy = [
        measured(simulate(None, command, {}, true), actuator, 20_000 + seed + n, COMMANDED)
        for n, command in enumerate(("moves", "swing"))
    ]
    start = time.process_time()
    report = calibrate(healthy, actuator)
    seconds = time.process_time() - start
    each, jointly = errors_over_deviations(true, report.calibration)
    print(
        f"drive {seed}, {seconds:.0f} CPU s, errors {each:.2f} and jointly {jointly:.2f} standard "
        f"deviations: {report.baseline.forms}",
        flush=True,
    )
    return true, report.calibration


def errors_over_deviations(true, calibration):
    """Errors of calibrated parameters in stated standard deviations, and jointly, RMS."""
    prior, model = calibration.baseline.prior, calibration.model
    unknowns = [model.unknown(calibration.actuator, name) for name in prior.names]
    z = np.array([coordinate(one, true.value(one.name)) for one in unknowns])
    for n, name in enumerate(prior.names):
        if name.endswith("phase"):  # an angle
            z[n] += 2.0 * np.pi * np.round((prior.mean[n] - z[n]) / (2.0 * np.pi))
    each = (z - prior.mean) / np.sqrt(np.diag(prior.covariance))
    return tuple(float(np.sqrt(np.mean(e**2))) for e in (each, prior.distances(z[None])[0]))


def judged(actuator, seed, *, voltages=COMMANDED, sheet=False, drive=None):
    """The `Row` of a mixture; ``drive`` is an actuator with its calibration."""
    model = model_of(actuator)
    values = mixture(model, actuator, seed)
    true, twin = drive or (off_sheet(actuator, seed) if sheet else actuator, actuator)
    also = [name for name in voltages if name in model.on_request]
    recording = measured(simulate(None, None, values, true, also=also), actuator, seed, voltages)
    start = time.process_time()
    found = identify(recording, twin, exact=not sheet and drive is None, threads=1)
    seconds = time.process_time() - start
    truth = model.values_of(true, values)
    magnitudes = [one for one in model.faults(actuator) if one.direction_of is None]
    size = {one.name: abs(truth[one.name] - one.healthy) / one.width for one in magnitudes}
    named = set(found.present)
    beyond = {}  # how far the truth lies outside the interval, in its half width
    for one in magnitudes:
        low, high = found.intervals[one.name]
        away = max(low - truth[one.name], truth[one.name] - high)
        beyond[one.name] = away / max(0.5 * (high - low), 1e-9)
    # what tolerances may cause as well is said beside the faults that are named
    told = found.verdict.sentence.lower()
    said = {n for n in size if n in found.verdict.faults or n.replace("_", " ") in told}
    return Row(
        seed,
        " ".join(f"{name}={value:.2f}" for name, value in values.items()),
        model.study.error_percent(model.faults(actuator), found.values, truth),
        found.verdict.grade,
        " ".join(name for name, share in size.items() if share >= LARGE and name not in said),
        " ".join(name for name in named if size[name] < SMALL),
        " ".join(
            name
            for name, away in beyond.items()
            if away > 0.5 and abs(found.values[name] - truth[name]) > 0.01
        ),
        sum(away <= 1e-9 for away in beyond.values()),
        len(magnitudes),
        seconds,
        found.relative_misfit,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--without-voltages", action="store_const", dest="voltages", const=(), default=COMMANDED
    )
    which.add_argument(
        "--measured-voltages", action="store_const", dest="voltages", const=TERMINALS
    )
    twin = parser.add_mutually_exclusive_group()
    twin.add_argument("--sheet", action="store_true")
    twin.add_argument("--calibrated", type=int, default=0, help="actuators off their sheet")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    actuator = load_actuator("servo400")
    judged(actuator, 0)  # compiles
    rows = []
    asked = [(None, given.first + n) for n in range(given.count)]
    if given.calibrated:
        firsts = [given.first + 100 * n for n in range(1, given.calibrated + 1)]
        drives = [(calibrated(actuator, first), first) for first in firsts]
        asked = [(drive, first + n) for drive, first in drives for n in range(given.count)]
    for drive, seed in asked:
        row = judged(actuator, seed, voltages=given.voltages, sheet=given.sheet, drive=drive)
        rows.append(row)
        print(
            f"{seed:3d} Err {row.error:6.2f} %  {row.grade:7} held {row.held}/{row.intervals}  "
            f"{row.seconds:4.1f} s  {row.injected}"
            + (f"  MISSED {row.missed}" if row.missed else "")
            + (f"  INVENTED {row.invented}" if row.invented else "")
            + (f"  OUTSIDE {row.outside}" if row.outside else ""),
            flush=True,
        )
    errors = np.array([row.error for row in rows])
    held = sum(row.held for row in rows) / sum(row.intervals for row in rows)
    grades = {grade: sum(row.grade == grade for row in rows) for grade in {r.grade for r in rows}}
    print(
        f"{len(rows)} mixtures: Err% median {np.median(errors):.2f}, P90 "
        f"{np.quantile(errors, 0.9):.2f}, worst {errors.max():.2f}; verdicts {grades}; "
        f"silently wrong {sum(row.silently_wrong for row in rows)}; intervals that hold "
        f"{100.0 * held:.1f} %; CPU time median {np.median([r.seconds for r in rows]):.1f} s"
    )
    if given.out is not None:
        with open(given.out, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(Row.__dataclass_fields__)
            writer.writerows([list(vars(row).values()) for row in rows])
    return 0


if __name__ == "__main__":
    sys.exit(main())
