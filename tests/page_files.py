"""What the pages take for granted: recordings and results that a reader has, by page."""

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ematwin
import made_up_axis
from bench_files import german_csv, write_mdf
from page_blocks import PROJECT

Names = dict[str, Any]


def servo(name: str, day: int, **faults: float) -> ematwin.Recording:
    """A short recording of a brushless servo, written to a file."""
    record = made_up_axis.run(day, **faults).changed(labels={})
    ematwin.write(record, name)
    return record


def of_bench() -> ematwin.Recording:
    """A recording at full length, as a bench takes it, written to a file."""
    noise = ematwin.Noise(white=0.02, bits=12)
    record = ematwin.simulate("reference", faults={"friction": 0.2}, noise=noise, seed=1)
    ematwin.write(record, "record.parquet")
    return record


def screw(name: str, runs: range, **faults: float) -> list[ematwin.Recording]:
    """Two motions of a ball screw for each run, written to a table."""
    random = np.random.default_rng(runs.start)
    motions = [
        ematwin.simulate(
            actuator="rm1605",
            faults={"friction": random.normal(1.0, 0.02), **faults},
            seed=10 * run + motion,
        ).changed(labels={"run": str(run), "motion": str(motion)})
        for run in runs
        for motion in (1, 2)
    ]
    ematwin.write(motions, name)
    return motions


def readme() -> Names:
    """Three healthy days and a fault, by the bench."""
    for day in (1, 2, 3):
        servo(f"day{day}.parquet", day)
    servo("today.parquet", 4, friction=0.25)
    return {}


def quickstart() -> Names:
    """The days of the README, and a load that was measured in flight."""
    readme()
    (Path("flight.csv")).write_text("time,hinge moment [kNm]\n0,0\n0.2,0.01\n0.5,0.005\n", "utf-8")
    return {}


def ball_screw() -> Names:
    """Healthy runs of two occasions, and today's."""
    screw("healthy.csv", range(1, 6))
    screw("spring.csv", range(6, 9))
    screw("today.csv", range(9, 11), friction=1.4)
    return {}


def certainty() -> Names:
    """A calibrated actuator and today's recording."""
    ematwin.calibrate([servo("day1.parquet", 1)], "servo48").save("arm.toml")
    servo("today.parquet", 2, friction=0.25)
    return {}


def linear_axis() -> Names:
    """A healthy and a later recording of the axis."""
    for name, friction in (("healthy", 1.0), ("later", 1.3)):
        record = ematwin.simulate(actuator="emps", faults={"friction": friction}, seed=1)
        ematwin.write(record, f"{name}.parquet")
    return {}


def bench_csv(record: ematwin.Recording) -> None:
    """A table as a bench writes it: three lines above, semicolons, commas, degrees, mA, cp1252."""
    columns = {
        "Zeit [ms]": 1e3 * record.time,
        "Sollwert [°]": np.degrees(record.command),
        "Motorwinkel [°]": np.degrees(record.motor_position),
        "Last [Nm]": record.load,
        "Strom U [mA]": 1e3 * record.current_a,
        "Strom V [mA]": 1e3 * record.current_b,
        "Strom W [mA]": 1e3 * record.current_c,
    }
    german_csv(Path("bench.csv"), columns)


def notebooks() -> Names:
    """A bench file with three lines above its table, and its map."""
    bench_csv(of_bench())
    proposal = ematwin.propose_map("bench.csv", "servo48")
    Path("map.toml").write_text(proposal.as_toml(), encoding="utf-8")
    return {}


def optimizers() -> Names:
    """A function to be minimised."""
    return {"objective": lambda x: float(((np.asarray(x) - 0.3) ** 2).sum())}


def recordings() -> Names:
    """An MDF file, a bench file with umlauts, tables of motions."""
    record = of_bench()
    channels = {
        "Setpoint [deg]": (np.degrees(record.command), "deg"),
        "Phase A [A]": (record.current_a, "A"), "Phase B [A]": (record.current_b, "A"),
    }  # fmt: skip
    write_mdf(Path("run7.mf4"), (record.time, channels))
    bench_csv(record)
    ematwin.write([m.changed(labels={**m.labels, "condition": "dry"})
                   for m in screw("monday.csv", range(1, 3))], "motions.csv")  # fmt: skip
    return {}


def your_actuator() -> Names:
    """Motions whose fault is known, and days of a servo."""
    made_up = runpy.run_path(str(PROJECT / "examples" / "made_up_actuator.py"))
    actuator = ematwin.load_actuator("rm1605").changed(made_up["TRUTH"])
    random = np.random.default_rng(2)

    def runs(numbers: range, condition: str, **faults: float) -> list[ematwin.Recording]:
        return [
            motion.changed(labels={**motion.labels, "condition": condition})
            for n in numbers
            for motion in made_up["run"](actuator, n, faults, random)
        ]

    known = [
        *runs(range(1, 6), "healthy"),
        *runs(range(6, 7), "dry", friction=1.4),
        *runs(range(3, 5), "worn", backlash=8e-4),
    ]
    ematwin.write(known, "all.csv")
    return readme()


GIVEN: dict[str, Callable[[], Names]] = {
    "README.md": readme,
    "docs/quickstart.md": quickstart,
    "docs/ball-screw.md": ball_screw,
    "docs/certainty.md": certainty,
    "docs/linear-axis.md": linear_axis,
    "docs/notebooks.md": notebooks,
    "docs/optimizers.md": optimizers,
    "docs/recordings.md": recordings,
    "docs/your-actuator.md": your_actuator,
}
