"""Answers that are corrected by the reference model, on drives as they are set: docs/trust.md.

    python benchmarks/correction.py --mixtures 20
    python benchmarks/correction.py --calibrated 2 --mixtures 4
    python benchmarks/correction.py --unstated 2 --mixtures 3

The actuator is servo48 at a position gain of 60 1/s and a speed gain of 0.004 N m s/rad, its
parameters known exactly, each row with a form that the fast model does not have. With
``--calibrated`` eight parameters of so many actuators are off the sheet, which states the form, and
each is calibrated on three healthy recordings: the default command, 4 Hz reversals of 4 mrad and
the ramp. Mixtures hold
three to seven faults; recordings are those of the reference model with 2 % white noise and a
converter of 12 bits. Seeds are of this benchmark alone. Prints a Markdown table: Err% (the paper's
measure), how many have a verdict, answers of the reference, and of all magnitudes errors over
standard errors (root mean square) and the share that intervals hold.

With ``--unstated`` recordings are of a simulator that shares no code with the twin
(tests/naive/another_actuator.py), the file states no form, and calibration has to find them:
position gains of 40 to 80 1/s, stated to 1 %, loops of 50 to 125 us, encoders of 2,000 to 20,000
counts whose speeds are filtered by 0, 0.2 or 0.5 ms, all drawn at random, the same
eight parameters off. Prints how many forms were found, missed and not there, how many calibrations
were refused, verdicts, how many of all recordings have every fault of 0.1 and more named,
verdicts that are silently wrong (a fault off by 0.01, and outside its
interval by half of its half width), and Err%. With ``--mixtures 0`` forms alone are looked for.
With ``--motions`` judged recordings are of other commands and sample rates, in turn, and every
second round of them is of the healthy drive.
"""

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from counted import MAGNITUDES, NOISE, holds, silently_wrong
from ematwin import Calibration, Scenario, calibrate, identify, simulate
from ematwin.errors import EmatwinError
from ematwin.estimation.forms import find_forms
from ematwin.models.bldc.faults import UNKNOWNS
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.registry import load_actuator

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

GAINS = {"controller.position_gain": 60.0, "controller.speed_gain": 0.004}
SPEED = {
    "speed_loop.integral_gain": 0.1, "speed_loop.sample_time": 1e-4, "speed_loop.delay": 1e-4,
}  # fmt: skip
CURRENT = {
    "current_loop.proportional_gain": 7.0, "current_loop.integral_gain": 12_000.0,
    "current_loop.sample_time": 5e-5, "current_loop.delay": 5e-5, "current_loop.lost_voltage": 1.0,
}  # fmt: skip
ROWS = {
    "ideal current control": {},
    "cogging, 1.5 mN m": {"cogging.torque": 1.5e-3, "cogging.cycles": 12, "cogging.phase": 0.3},
    "rounded EMF, 0.3": {"emf.rounding": 0.3},
    "gear that gives, 10 N m/rad": {"compliance.stiffness": 10.0, "compliance.damping": 0.005},
    "PI current loop, 50 us": CURRENT,
    "PI speed loop, 100 us": SPEED,
    "PI speed and current loops": {**SPEED, **CURRENT},
}
UNSTATED: dict[str, tuple[str, ...]] = {
    "ideal current control": (),
    "PI speed loop": ("speed loop",),
    "PI current loop": ("current loop",),
    "both loops": ("speed loop", "current loop"),
    "both loops and encoders": ("speed loop", "current loop", "encoder"),
    "both, cogging, rounded EMF": ("speed loop", "current loop", "cogging", "rounded EMF"),
    "all of it": (
        "speed loop", "current loop", "encoder", "cogging", "rounded EMF", "presliding",
    ),
}  # fmt: skip
INTERVALS = (50e-6, 62e-6, 75e-6, 100e-6, 125e-6)  # s
REVERSALS = Scenario(
    name="reversals", duration=0.6, command=[{"type": "sine", "amplitude": 0.004, "frequency": 4.0}]
)
MOVES = Scenario(  # there, a rest, further, and back
    name="moves", duration=0.9, command=[
        {"type": "profile", "time": [0.02, 0.12, 0.2, 0.38, 0.45, 0.6, 0.7, 0.75],
         "value": [0.0, 0.01, 0.01, -0.01, -0.01, 0.005, 0.005, 0.0]},
    ],
)  # fmt: skip
AGAINST = Scenario(
    name="against a load", duration=1.0, command=[
        {"type": "profile", "time": [0.02, 0.35, 0.5, 0.83], "value": [0.0, 0.03, 0.03, 0.0]},
    ],
    load=[{"type": "step", "value": 8.0, "time": 0.25}],
)  # fmt: skip
STEPS = Scenario(
    name="steps", duration=0.6,
    command=[{"type": "step", "value": x, "time": 0.1 * n}
             for n, x in ((1, 0.004), (2, -0.004), (3, 0.004), (4, -0.004), (5, 0.004))],
)  # fmt: skip
SINE = Scenario(
    name="sine", duration=0.7, command=[{"type": "sine", "amplitude": 0.004, "frequency": 3.0}],
    load=[{"type": "sine", "amplitude": 3.0, "frequency": 1.3}],
)  # fmt: skip
# of recordings that are judged with ``--motions``, and their sample rates, Hz
MOTIONS: tuple[tuple[Any, float], ...] = (
    (AGAINST, 20e3), (MOVES, 20e3), (STEPS, 20e3), (SINE, 20e3), ("default", 10e3),
    ("default", 5e3), (MOVES, 5e3), ("ramp", 20e3),
)  # fmt: skip
OFF = {  # standard deviations of logarithms
    "motor.resistance": 0.05, "motor.inertia": 0.04, "motor.emf_constant": 0.02,
    "motor.viscous_damping": 0.1, "motor.friction_torque": 0.1,
    "transmission.friction_torque": 0.1, "transmission.backlash": 0.15,
    "drive.supply_voltage": 0.02,
}  # fmt: skip
REACHES = {"gain": (0.05, 0.3), "friction": (0.05, 0.6), "backlash": (0.02, 0.4)}
OTHERS = (0.03, 0.4)
HEALTHY = {one.name: one.healthy for one in UNKNOWNS}
LARGE = 0.1  # share of the range, from which a fault should be named


def mixture(seed: int) -> dict[str, float]:
    """Values of all faults."""
    rng = np.random.default_rng([seed, 40])
    found: dict[str, float] = {}
    for name in rng.permutation(MAGNITUDES)[: rng.integers(3, 8)].tolist():
        size = float(rng.uniform(*REACHES.get(name, OTHERS)))
        found[name] = 0.5 + size * float(rng.choice([-1.0, 1.0])) if name == "gain" else size
    if "eccentricity" in found:
        found["eccentricity_phase"] = float(rng.uniform())
    return MODEL.values_of(None, found)


def judged(
    actuator: BldcActuator, seed: int, twin: Calibration | None = None
) -> tuple[float, bool, int, list[float], list[bool]]:
    """Err%, whether there is a verdict, answers of the reference, errors, and what is held.

    ``twin`` is what a calibration learnt of the actuator; known exactly if not given.
    """
    values = mixture(seed)
    record = simulate("reference", faults=values, actuator=actuator, noise=NOISE, seed=seed)
    found = identify(record, twin or actuator, exact=twin is None, threads=1)
    away = [(found.values[name] - values[name]) / found.standard_error[name] for name in MAGNITUDES]
    held = [holds(found.intervals[name], values[name]) for name in MAGNITUDES]
    err = MODEL.study.error_percent(MODEL.faults(actuator), found.values, values, wrapped=True)
    return err, found.verdict.grade != "none", found.reference_runs, away, held


def off_sheet(
    sheet: BldcActuator, first: int, mixtures: int
) -> list[tuple[float, bool, int, list[float], list[bool]]]:
    """The same of an actuator that is off its sheet, calibrated; nothing if that is refused."""
    rng = np.random.default_rng([first, 41])
    truth = sheet.changed(
        {place: sheet.value(place) * math.exp(rng.normal(0.0, off)) for place, off in OFF.items()}
    )
    healthy = [
        simulate("reference", command, actuator=truth, noise=NOISE, seed=first + n)
        for n, command in enumerate(("default", REVERSALS, "ramp"))
    ]
    try:
        twin = calibrate(healthy, sheet).calibration
    except EmatwinError as error:
        print(error, file=sys.stderr)
        return []
    return [judged(truth, seed, twin) for seed in range(first, first + mixtures)]


def as_built(name: str, sheet: BldcActuator, rng: np.random.Generator) -> Any:
    """An actuator off its sheet, and what of a drive the simulator of other make gives it."""
    from naive import another_actuator as other

    truth = sheet.changed({
        "controller.position_gain": float(rng.uniform(40.0, 80.0)),
        **{place: sheet.value(place) * math.exp(rng.normal(0.0, x)) for place, x in OFF.items()},
    })  # fmt: skip
    interval = float(rng.choice(INTERVALS))
    (also,) = rng.spawn(1)  # what other rows draw stays
    drawn: dict[str, dict[str, float]] = {
        "speed loop": {
            "speed_integral": 0.004 / float(rng.uniform(0.02, 0.06)),
            "control_interval": float(rng.choice([x for x in INTERVALS if x >= interval])),
        },
        "current loop": {
            "current_interval": interval, "lost_voltage": float(rng.uniform(0.0, 1.5)),
            "current_bandwidth": float(rng.uniform(0.25, 0.4)) / interval,
        },
        "cogging": {
            "cogging": float(rng.uniform(5e-4, 2e-3)),
            "cogging_cycles": float(rng.choice((6, 12, 24))),
            "cogging_phase": float(rng.uniform(0.0, 2.0 * math.pi)),
        },
        "rounded EMF": {"emf_rounding": float(rng.uniform(0.05, 0.3))},
        "encoder": {
            "encoder_lines": float(rng.choice((2000, 4096, 10_000, 20_000))),
            "output_lines": 2.0 ** rng.integers(20, 24) / sheet.transmission.ratio,
            "speed_lag": float(rng.choice((0.0, 2e-4, 5e-4))),
            "encoder_phase": float(rng.uniform()),
        },
        "presliding": {
            name: float(also.uniform(*other.RANGES[name]))
            for name in ("bristle_stiffness", "bristle_damping", "stribeck_speed")
        },
    }  # fmt: skip
    terms = {key: x for term in UNSTATED[name] for key, x in drawn[term].items()}
    return truth, other.Structure(**terms)


def forms_of(actuator: BldcActuator) -> set[str]:
    """Terms of `UNSTATED` that an actuator has."""
    has = {
        "speed loop": actuator.speed_loop, "current loop": actuator.current_loop,
        "cogging": actuator.cogging, "rounded EMF": actuator.emf, "encoder": actuator.encoder,
        "presliding": actuator.presliding,
    }  # fmt: skip
    return {name for name, section in has.items() if section is not None}


def of_unstated(
    name: str, seed: int, mixtures: int, without: tuple[str, ...] = (), healthy_too: bool = False,
    one_current: bool = False, motions: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """What calibration finds of a drive whose file states no form, and what follows.

    Judged recordings are ``without`` some channels, and healthy ones too if so asked. With
    ``one_current`` all recordings hold the equivalent current in place of those of the phases; with
    ``motions`` judged ones are of `MOTIONS` in turn, and every second round of a healthy drive.
    """
    from bldc_inputs import with_one_current
    from naive import another_actuator as other

    rng = np.random.default_rng([seed, 42])
    truth, structure = as_built(name, load_actuator("servo48").changed(GAINS), rng)
    gain = truth.value("controller.position_gain") * math.exp(rng.normal(0.0, 0.005))
    sheet = load_actuator("servo48").changed({**GAINS, "controller.position_gain": gain})
    sheet = sheet.with_tolerances(dict.fromkeys(GAINS, 0.01))

    def record(command: Any, faults: dict[str, float], number: int, rate: float = 20e3) -> Any:
        scenario = MODEL.load_scenario(command)
        grid = np.arange(0.0, scenario.duration + 1e-9, 5e-5)
        parameters = other.parameters_of(truth)
        begins = np.random.default_rng([seed, number, 43]).uniform()  # among the samples
        now = structure._replace(sampling_phase=float(begins))
        found = other.simulate(
            parameters, grid, *scenario.histories(grid), faults, now, seed=seed + number,
            sample_rate=rate,
        )  # fmt: skip
        if one_current:
            found = with_one_current(found)
        lacks = without if faults or healthy_too else ()
        return found.changed(**dict.fromkeys(lacks))

    found: dict[str, Any] = {"name": name, "seed": seed, "judged": []}
    healthy = [record(one, {}, n) for n, one in enumerate(("default", REVERSALS, "ramp"))]
    begun = time.process_time()
    if mixtures == 0:
        beside = [MODEL.compare(one, sheet) for one in healthy]
        forms = find_forms(MODEL, sheet, beside)
        seconds = time.process_time() - begun
        has = sorted(forms_of(forms.actuator))
        return {**found, "seconds": seconds, "said": forms.said, "has": has}
    try:
        report = calibrate(healthy, sheet)
    except EmatwinError as error:
        return {**found, "refused": str(error), "seconds": time.process_time() - begun}
    found |= {
        "seconds": time.process_time() - begun, "misfit": report.baseline.misfit,
        "said": report.baseline.forms, "has": sorted(forms_of(report.actuator)),
    }  # fmt: skip
    for n in range(mixtures):
        values, command = mixture(seed + n), ("default", 20e3)
        if motions:
            command = MOTIONS[n % len(MOTIONS)]
            values = MODEL.values_of(None, {}) if n // len(MOTIONS) % 2 else values
        judged = record(command[0], values, 100 + n, command[1])
        begun = time.process_time()
        seen = identify(judged, report.calibration, threads=1)
        took = time.process_time() - begun
        err = MODEL.study.error_percent(MODEL.faults(truth), seen.values, values, wrapped=True)
        grade, intervals = seen.verdict.grade, seen.intervals
        wrong = silently_wrong(grade, seen.values, intervals, values)
        inside = {one: holds(intervals[one], values[one]) for one in MAGNITUDES}
        held = float(np.mean(list(inside.values())))
        there = [inside[one] for one in MAGNITUDES if values[one] != HEALTHY[one]]
        large = {one for one in MAGNITUDES if abs(values[one] - HEALTHY[one]) >= LARGE}
        named = large <= set(seen.verdict.faults)
        found["judged"].append([err, grade, wrong, held, named, there, took])
    return found


def row_of_unstated(name: str, results: list[dict[str, Any]]) -> str:
    known = [one for one in results if "has" in one]
    there = set(UNSTATED[name])
    right = sum(len(there & set(one["has"])) for one in known)
    false = sum(len(set(one["has"]) - there) for one in known)
    judged = [one for each in known for one in each["judged"]]
    errs = [one[0] for one in judged] or [math.nan]
    there_held = [held for one in judged if one[1] != "none" for held in one[5]]
    return (
        f"| {name} | {right} of {len(there) * len(known)} | {false} | "
        f"{len(results) - len(known)} of {len(results)} | "
        f"{sum(one[1] != 'none' for one in judged)} of {len(judged)} | "
        f"{sum(one[4] for one in judged)} | {sum(one[2] for one in judged)} | "
        f"{np.median(errs):.2f} / {np.quantile(errs, 0.9):.2f} | "
        f"{100.0 * np.mean([one[3] for one in judged]) if judged else math.nan:.0f} / "
        f"{100.0 * np.mean(there_held) if there_held else math.nan:.0f} | "
        f"{np.median([one['seconds'] for one in results]):.0f} / "
        f"{np.median([one[6] for one in judged]) if judged else math.nan:.1f} |"
    )


def row(name: str, results: list[tuple[float, bool, int, list[float], list[bool]]]) -> str:
    errs, verdicts, runs, away, held = (np.array(column) for column in zip(*results, strict=True))
    size = np.sqrt(np.mean(np.square(away)))
    return (
        f"| {name} | {np.median(errs):.2f} / {np.quantile(errs, 0.9):.2f} | "
        f"{verdicts.sum()} of {len(errs)} | {np.median(runs):.0f} / {np.quantile(runs, 0.9):.0f} | "
        f"{size:.2f} | {100.0 * held.mean():.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--mixtures", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first mixture")
    parser.add_argument("--calibrated", type=int, default=0, help="actuators off their sheet")
    parser.add_argument("--unstated", type=int, default=0, help="drives whose file has no form")
    parser.add_argument("--only", help="the row of this name alone")
    parser.add_argument("--without", default="", help="channels that judged recordings lack")
    parser.add_argument("--healthy-too", action="store_true", help="healthy ones lack them as well")
    parser.add_argument("--one-current", action="store_true", help="in place of three phases")
    parser.add_argument("--motions", action="store_true", help="other commands and sample rates")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    if asked.unstated:
        without = tuple(filter(None, asked.without.split(",")))
        print(
            "| the drive has | forms found | not there | calibration refused | verdicts "
            "| all named | silently wrong | Err%, median / P90 "
            "| intervals that hold, all / of verdicts on faults that are there, % "
            "| CPU s, calibration / answer |"
        )
        print(f"|---|{'--:|' * 9}")
        for name in UNSTATED:
            if asked.only in (None, name):
                seeds = [asked.first + 1000 * (1 + n) for n in range(asked.unstated)]
                how = without, asked.healthy_too, asked.one_current, asked.motions
                found = Parallel(asked.workers)(
                    delayed(of_unstated)(name, seed, asked.mixtures, *how) for seed in seeds
                )
                for one in found:
                    print(one, file=sys.stderr)
                print(row_of_unstated(name, found), flush=True)
        return
    drive = load_actuator("servo48").changed(GAINS)
    print(
        "| the actuator has | Err%, median / P90 | verdict | answers of the reference, median / "
        "P90 | error over standard error | intervals that hold, % |"
    )
    print("|---|--:|--:|--:|--:|--:|")
    for name, form in ROWS.items():
        if asked.only not in (None, name):
            continue
        actuator = drive.changed(form) if form else drive
        seeds = range(asked.first, asked.first + asked.mixtures)
        if asked.calibrated:
            firsts = [asked.first + 1000 * (1 + n) for n in range(asked.calibrated)]
            found = Parallel(asked.workers)(
                delayed(off_sheet)(actuator, first, asked.mixtures) for first in firsts
            )
            results = [one for each in found for one in each]
            if not results:
                print(f"| {name} | calibration refused |", flush=True)
                continue
        else:
            results = Parallel(asked.workers)(delayed(judged)(actuator, seed) for seed in seeds)
        print(row(name, results), flush=True)


if __name__ == "__main__":
    main()
