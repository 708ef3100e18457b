"""Mixtures of up to five faults of a PMSM servo: error, verdict, intervals, time.

    python benchmarks/pmsm_mixtures.py [--count 50] [--first 0]
                                       [--sheet | --calibrated 4 [--drifted]] [--naive]
                                       [--without-voltages | --measured-voltages] [--out FILE]

The recordings are of the reference model (5 us, quantised sensors) or, with ``--naive``, of
tests/naive/pmsm.py, which shares no code with the twin; with white noise of 2 % of the RMS and
converters of 12 bits on phase currents and voltages, those that the drive commands or, with
``--measured-voltages``, those at the terminals. The twin is told the parameters, not the faults.
With ``--sheet`` the parameters of each actuator, its load cell and the contact of its shorts are
drawn from what is known of them beforehand, and the twin is told the sheet. With ``--calibrated``
so many actuators are off their sheet, and have cogging, harmonics of the EMF and presliding
friction that it does not state; each is calibrated on two healthy recordings, and judged on
``--count`` mixtures. With ``--drifted`` parameters have drifted since, and load cell and contact
are off, as far as priors say. Of a calibration: errors of the parameters over their stated
deviations, each for itself and jointly, root mean square; 1 is right.

Of each: Err% (the norm of the differences of the normalised magnitudes, in per cent; a direction
counts by its magnitude), the grade of the verdict, how many of the 95 % intervals hold what was
injected, and whether a verdict is silently wrong: a fault of 5 % or more is not mentioned, one is
named that is not there, or a value is off by 0.01 and its interval misses the truth by half of its
half width, and nothing is said. Of verdicts: intervals that hold, and errors over standard errors
of the faults that are there, root mean square.
"""

import argparse
import json
import re
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from counted import BEYOND, OFF, holds, outside_by
from ematwin import Noise, Recording, calibrate, identify, simulate
from ematwin.errors import ParameterError
from ematwin.estimation.baseline import uncertain
from ematwin.estimation.constants import TWO_SIGMA
from ematwin.estimation.prior import coordinate
from ematwin.models.pmsm.channels import TERMINALS, to_phases
from ematwin.models.pmsm.comparison import SETTLED
from ematwin.models.registry import load_actuator, model_of

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from naive.pmsm import servo

NOISE, BITS = 0.02, 12
MOST = 5  # faults
LARGE = 0.05  # share of the range from which a fault should be named
SMALL = 0.02  # below which none should be
LOAD_CELL = 0.01  # of its gain, standard deviation, while an actuator is calibrated
SEVERITY = (0.1, 0.8)  # share of the way to a bound


@dataclass(frozen=True)
class Row:
    """What came out for one mixture; ``outside`` is by how many half widths, by fault."""

    seed: int
    injected: dict[str, float]
    truth: dict[str, float]
    values: dict[str, float]
    errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    probabilities: dict[str, float]
    error: float
    grade: str
    missed: list[str]
    invented: list[str]
    outside: dict[str, float]
    deviations: dict[str, float]
    held: int
    seconds: float
    misfit: float
    sentence: str

    @property
    def silently_wrong(self):
        return self.grade != "none" and bool(self.missed or self.invented or self.outside)


def mixture(model, actuator, seed):
    """Up to five faults, at most one of them a short; directions at random."""
    random = np.random.default_rng(seed)
    groups = {}
    for one in model.faults(actuator):
        if one.direction_of is None:
            group = "short" if one.name.startswith("short") else one.name
            groups.setdefault(group, []).append(one)
    names = random.choice(sorted(groups), size=random.integers(MOST + 1), replace=False)
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


def drawn(actuator, unknowns, seed):
    """An actuator off by the priors of unknowns, and its nuisances; impossible ones again."""
    random = np.random.default_rng(seed)
    while True:
        values = {}
        for one in unknowns:
            z = coordinate(one, one.healthy) + one.spread * random.normal()
            values[one.name] = float(np.exp(z) if one.logarithmic else z)
        rest = {name: values.pop(name) for name in list(values) if "." not in name}
        bounds = {one.name: (one.lower, one.upper) for one in unknowns}
        if all(bounds[name][0] <= x <= bounds[name][1] for name, x in rest.items()):
            with suppress(ParameterError):
                return actuator.changed(values), rest


def nuisances(actuator):
    """Contact of a short, and load cell."""
    return [one for one in model_of(actuator).unknowns(actuator) if one.marginal]


def off_sheet(actuator, seed):
    """An actuator as its sheet has it, within tolerances, and its nuisances."""
    unknowns = [*uncertain(model_of(actuator), actuator), *nuisances(actuator)]
    return drawn(actuator, unknowns, 50_000 + seed)


def later(actuator, seed):
    """An actuator that has drifted since it was calibrated, and its nuisances."""
    model, found = model_of(actuator), []
    for place, *_ in actuator.parameters():
        drift = actuator.drift(place)
        if drift is not None:
            spread = np.log1p(drift) / TWO_SIGMA
            found.append(replace(model.unknown(actuator, place), spread=spread))
    return drawn(actuator, [*found, *nuisances(actuator)], 70_000 + seed)


def as_built(actuator, seed):
    """The same with forms that the sheet does not state."""
    random = np.random.default_rng(60_000 + seed)
    true, off = off_sheet(actuator, seed)
    return true.changed({
        "motor.cogging_torque": random.uniform(0.005, 0.03),
        "motor.cogging_periods": int(random.choice((10, 12, 60))),
        "motor.cogging_phase": random.uniform(-np.pi, np.pi),
        "motor.harmonic_5": random.uniform(-0.05, 0.05),
        "motor.harmonic_7": random.uniform(-0.025, 0.025),
        "presliding.motor_stiffness": random.uniform(10.0, 60.0),
        "presliding.output_stiffness": random.uniform(10.0, 60.0),
        "presliding.damping": random.uniform(0.005, 0.02),
    }), off  # fmt: skip


def by_reference(true, command, values, voltages):
    """A recording of the reference model."""
    also = [name for name in voltages if name in model_of(true).on_request]
    return simulate(None, command, values, true, also=also)


def by_naive(true, command, values, voltages):
    """The same of tests/naive/pmsm.py."""
    model = model_of(true)
    scenario = model.load_scenario(command)
    true = true.changed({"motor.short_resistance": values.get("short_resistance", 0.5)})
    values = model.values_of(true, values)
    ratio, tick = true.transmission.ratio, true.controller.current_time
    time = np.arange(round(scenario.duration / tick) + 1) * tick
    asked, load = scenario.histories(time)
    held = round(SETTLED / tick)
    before = [np.concatenate([np.full(held, one[0]), one]) for one in (asked * ratio, load / ratio)]
    run = servo(true, values, *before, steps=8, perfect=False)
    seen = {name: one[held:] for name, one in run.items()}
    angle = true.motor.pole_pairs * seen["motor_position"]
    channels = {"command": asked, "load": load}
    for quantity, names in (("current", "current_{}"), ("voltage", "voltage_{}"),
                            ("terminal", "terminal_voltage_{}")):  # fmt: skip
        phases = to_phases(seen[f"{quantity}_d"], seen[f"{quantity}_q"], angle)
        channels |= {names.format(x): one for x, one in zip("abc", phases, strict=True)}
    channels["motor_position"] = seen["motor_position"]
    channels["output_position"] = seen["output_position"] / ratio
    kept = {n: one for n, one in channels.items() if n not in model.on_request or n in voltages}
    return Recording(time, kept, units={n: model.channel(n).unit for n in kept})


def recorded(by, true, off, actuator, seed, *, command=None, faults=None, voltages=COMMANDED):
    """A recording whose load cell is ``off``, with noise."""
    contact = {n: x for n, x in off.items() if n == "short_resistance"}
    clean = by(true, command, {**(faults or {}), **contact}, voltages)
    seen = (clean.channels["load"] - off.get("load_offset", 0.0)) / off.get("load_gain", 1.0)
    return measured(clean.changed(load=seen), actuator, seed, voltages)


def calibrated(actuator, seed, by, voltages, drifted):
    """An actuator as it is built, its nuisances, and its calibration."""
    true, off = as_built(actuator, seed)
    if not drifted:
        off = {"short_resistance": off["short_resistance"]}
    # healthy recordings are made under a load that is known well
    cell = [
        replace(one, spread=LOAD_CELL) if one.name == "load_gain" else one
        for one in nuisances(actuator)
        if drifted and one.name != "short_resistance"
    ]
    healthy = [
        recorded(
            by, true, drawn(actuator, cell, 80_000 + seed + n)[1], actuator, 20_000 + seed + n,
            command=command, voltages=voltages,
        )
        for n, command in enumerate(("moves", "swing"))
    ]  # fmt: skip
    start = time.process_time()
    report = calibrate(healthy, actuator)
    seconds = time.process_time() - start
    each, jointly = errors_over_deviations(true, report.calibration)
    print(
        f"drive {seed}, {seconds:.0f} CPU s, errors {each:.2f} and jointly {jointly:.2f} standard "
        f"deviations, misfit {100 * report.baseline.misfit:.2f} %: {report.baseline.forms}",
        flush=True,
    )
    return true, off, report.calibration


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


def judged(actuator, seed, true, off, twin, *, exact=False, voltages=COMMANDED, by=by_reference):
    """The `Row` of a mixture of an actuator with its nuisances, by what is known of it."""
    model = model_of(actuator)
    injected = mixture(model, actuator, seed)
    recording = recorded(by, true, off, actuator, seed, faults=injected, voltages=voltages)
    start = time.process_time()
    found = identify(recording, twin, exact=exact, threads=1)
    seconds = time.process_time() - start
    truth = model.values_of(true, injected)
    magnitudes = [one for one in model.faults(actuator) if one.direction_of is None]
    size = {one.name: abs(truth[one.name] - one.healthy) / one.width for one in magnitudes}
    beyond = {name: outside_by(found.intervals[name], truth[name]) for name in size}
    # what tolerances may cause as well is said beside the faults that are named
    told = found.verdict.sentence.lower()
    said = {n for n in size if n in found.verdict.faults or n.replace("_", " ") in told}
    wrong = {name: found.values[name] - truth[name] for name in size}
    return Row(
        seed,
        injected,
        {name: truth[name] for name in size},
        {name: found.values[name] for name in truth if name in found.values},
        {name: found.standard_error[name] for name in size},
        {name: found.intervals[name] for name in size},
        found.probabilities,
        model.study.error_percent(model.faults(actuator), found.values, truth),
        found.verdict.grade,
        [name for name, share in size.items() if share >= LARGE and name not in said],
        [name for name in found.present if size[name] < SMALL],
        {n: away for n, away in beyond.items() if away > BEYOND and abs(wrong[n]) > OFF},
        {n: wrong[n] / found.standard_error[n] for n in size if size[n] >= SMALL},
        sum(holds(found.intervals[name], truth[name]) for name in size),
        seconds,
        found.relative_misfit,
        found.verdict.sentence,
    )


def root_mean_square(values):
    return float(np.sqrt(np.mean(np.square(values)))) if values else np.nan


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
    parser.add_argument("--drifted", action="store_true", help="since they were calibrated")
    parser.add_argument(
        "--naive", action="store_const", dest="by", const=by_naive, default=by_reference
    )
    parser.add_argument("--out", type=Path, help="rows as JSON, one a line")
    given = parser.parse_args()
    sheet, by, voltages = load_actuator("servo400"), given.by, given.voltages
    judged(sheet, 1, sheet, {}, sheet, exact=True)  # compiles

    def asked():
        seeds = range(given.first, given.first + given.count)
        for first in (given.first + 100 * n for n in range(1, given.calibrated + 1)):
            true, off, known = calibrated(sheet, first, by, voltages, given.drifted)
            for seed in range(first, first + given.count):
                now, cell = later(true, seed) if given.drifted else (true, off)
                yield seed, now, cell, known
        for seed in seeds if not given.calibrated else ():
            yield seed, *(off_sheet(sheet, seed) if given.sheet else (sheet, {})), sheet

    rows, exact = [], not (given.sheet or given.calibrated)
    for seed, true, off, known in asked():
        row = judged(sheet, seed, true, off, known, exact=exact, voltages=voltages, by=by)
        rows.append(row)
        injected = " ".join(f"{name}={value:.2f}" for name, value in row.injected.items())
        outside = " ".join(f"{name} by {away:.1f}" for name, away in row.outside.items())
        print(
            f"{seed:3d} Err {row.error:6.2f} %  {row.grade:7} held {row.held}/{len(row.intervals)}"
            f"  {row.seconds:4.1f} s  misfit {100 * row.misfit:.2f} %  {injected or 'healthy'}"
            + (f"  MISSED {' '.join(row.missed)}" if row.missed else "")
            + (f"  INVENTED {' '.join(row.invented)}" if row.invented else "")
            + (f"  OUTSIDE {outside}" if outside else ""),
            flush=True,
        )
        if given.out is not None:
            with open(given.out, "a", encoding="utf-8") as file:
                file.write(json.dumps(vars(row)) + "\n")
    errors = np.array([row.error for row in rows])
    told = [row for row in rows if row.grade != "none"] or rows
    held = sum(row.held for row in told) / sum(len(row.intervals) for row in told)
    grades = {grade: sum(row.grade == grade for row in rows) for grade in {r.grade for r in rows}}
    healthy = [row for row in rows if not row.injected]
    away = [z for row in told for z in row.deviations.values()]
    print(
        f"{len(rows)} mixtures: Err% median {np.median(errors):.2f}, P90 "
        f"{np.quantile(errors, 0.9):.2f}, worst {errors.max():.2f}; verdicts {grades}; "
        f"silently wrong {sum(row.silently_wrong for row in rows)}; healthy called faulty "
        f"{sum(row.grade == 'fault' for row in healthy)} of {len(healthy)}; intervals that hold "
        f"{100.0 * held:.1f} %; errors over standard errors {root_mean_square(away):.2f}; CPU time "
        f"median {np.median([row.seconds for row in rows]):.1f} s"
    )
    groups = {}
    for row in told:
        for name in row.intervals:
            groups.setdefault(re.sub("_[abc]$", "", name), []).append((row, name))
    for group, members in groups.items():
        inside = [holds(row.intervals[name], row.truth[name]) for row, name in members]
        away = [row.deviations[name] for row, name in members if name in row.deviations]
        print(
            f"{group:<20} held {100.0 * np.mean(inside):5.1f} % of {len(inside)}, errors over "
            f"standard errors {root_mean_square(away):.2f} of {len(away)}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
