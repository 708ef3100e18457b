"""A real position servo: calibrate on healthy runs, judge others.

The tables hold many runs, told apart by a column `run`, as docs/position-servo.md describes them:
time, goal_position and position, with mass, length and arm_mass of the pendulum that the servo
moved. Healthy runs are those at register P 16 where there is a column position_gain, else all.

python examples/position_servo.py CALIBRATION.parquet
python examples/position_servo.py CALIBRATION.parquet --judge TEST.parquet
python examples/position_servo.py CALIBRATION.parquet --judge TEST.parquet --json
python examples/position_servo.py CALIBRATION.parquet --judge TEST.parquet --together start
python examples/position_servo.py CALIBRATION.parquet --judge TEST.parquet --page servo.html
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import ematwin
from ematwin.errors import EmatwinError, InputError, RecordError
from ematwin.estimation.identification import Identification
from ematwin.files import check_target
from ematwin.models.position_servo.recorded import stretch
from ematwin.models.registry import load_actuator, model_of
from ematwin.monitoring.calibration import Calibration
from ematwin.recordings.recording import Recording

HEALTHY_GAIN = 16.0  # register P
USUAL = "sts3215"


def main() -> None:
    """Print the calibration and a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("calibration", nargs="?", type=Path, help="table of healthy runs")
    parser.add_argument("--judge", type=Path, help="table of runs that are judged")
    parser.add_argument(
        "--template", help="actuator to start from; by default the one that the column servo names"
    )
    parser.add_argument(
        "--together", metavar="COLUMN", help="judge runs with the same text in a column together"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--page", type=Path, help="write a page (.html) on all runs")
    given = parser.parse_args()
    if given.page is not None and (given.judge is None or given.together is not None):
        parser.error("--page shows runs judged one by one: give --judge, and leave --together out")
    if given.calibration is None:
        print(
            "Give a table (.parquet or .csv) of healthy runs of a servo. docs/position-servo.md "
            "says what it holds and how to log one."
        )
        return
    try:
        if given.page is not None:
            check_target(given.page, (".html",))
        twin = calibrated(given.calibration, given.template, quiet=given.json)
        if given.judge is None:
            return
        runs, refused = runs_of(given.judge, twin.actuator)
        if given.together is not None:
            rows = [row for some in groups(runs, given.together) for row in together(some, twin)]
        else:
            detection = ematwin.identify(runs, twin)
            found = [one.identification for one in detection.motions]  # after Ctrl-C the first ones
            rows = [row_of(run, one, twin) for run, one in zip(runs, found, strict=False)]
            if detection.missing:
                print(f"Interrupted: {detection.missing} more were not judged.", file=sys.stderr)
            if given.page is not None:
                detection.report(given.page)
    except EmatwinError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit("Interrupted; nothing was left half-written.")
    rows += [unread(run, why) for run, why in refused.items()]
    print(json.dumps({"runs": rows}, indent=2) if given.json else table(rows))


def calibrated(path: Path, template: str | None, *, quiet: bool) -> Calibration:
    """The servo as its healthy runs show it."""
    runs, refused = runs_of(path, template or USUAL)
    healthy = [
        one for one in runs
        if float(one.labels.get("position_gain", HEALTHY_GAIN)) == HEALTHY_GAIN
    ]  # fmt: skip
    if not healthy:
        there = ", ".join(sorted({one.labels["position_gain"] for one in runs}))
        raise InputError(
            f"{path} has no healthy run: its column position_gain holds {there}, and healthy is "
            f"{HEALTHY_GAIN:g}. Give a table with healthy runs."
        )
    report = ematwin.calibrate(healthy, template or template_of(runs))
    if not quiet:
        print(f"{len(healthy)} healthy runs of {report.actuator.name}:")
        for one in report.parameters:
            print(
                f"  {one.place:<26}{one.value:>10.4g}  standard error {one.standard_error:.2g}"
                f"{'' if one.determined else ', hardly more than was known'}"
            )
        for note in (*report.notes, *refused.values()):
            print(f"  {note}")
    return report.calibration


def runs_of(path: Path, actuator: Any) -> tuple[list[Recording], dict[str, str]]:
    """The runs of a table, and why others cannot be read, by run."""
    try:
        return ematwin.read(path, actuator=actuator, split=True, gaps="longest"), {}
    except RecordError as error:
        if path.suffix != ".parquet":
            raise
        whole = str(error)
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    rows = pq.read_table(path)
    if "run" not in rows.column_names:
        raise RecordError(f"{path} has no column run, which tells its runs apart. Add it.")
    found, refused = [], {}
    for run in pc.unique(rows["run"]).to_pylist():
        with tempfile.TemporaryDirectory() as folder:
            alone = Path(folder, path.name)
            pq.write_table(rows.filter(pc.equal(rows["run"], run)), alone)
            try:
                found += ematwin.read(alone, actuator=actuator, split=True, gaps="longest")
            except RecordError as error:
                refused[str(run)] = str(error).replace(f"{folder}/", "")
    if not found:
        raise RecordError(next(iter(refused.values()), whole))
    return found, refused


def template_of(runs: list[Recording]) -> str:
    """The shipped set that the column servo names, else the usual one."""
    name = runs[0].labels.get("servo", USUAL)
    shipped = model_of(load_actuator(USUAL)).parameters.shipped()
    if name.lower() in shipped:
        return name.lower()
    print(
        f"The column servo holds {name!r}, of which there is no shipped set; {USUAL} is taken. "
        f"If another is nearer, give --template: {', '.join(shipped)}, or a file.",
        file=sys.stderr,
    )
    return USUAL


def groups(runs: list[Recording], column: str) -> list[list[Recording]]:
    """Runs with the same text in a column.

    Raises
    ------
    InputError
        If there is no such column.
    """
    if not any(column in one.labels for one in runs):
        there = ", ".join(sorted({name for one in runs for name in one.labels})) or "none"
        raise InputError(
            f"The runs have no column {column!r} to be judged together by. Columns of text or of "
            f"one value for each run: {there}."
        )
    found: dict[str, list[Recording]] = {}
    for one in runs:
        found.setdefault(one.labels.get(column, ""), []).append(one)
    return list(found.values())


def together(runs: list[Recording], twin: Calibration) -> list[dict[str, Any]]:
    """Rows of runs that have one answer."""
    found = ematwin.identify(runs, twin, together=True)
    return [row_of(one, found, twin) for one in runs]


def unread(run: str, why: str) -> dict[str, Any]:
    """The row of a run that cannot be read."""
    return {
        "run": int(run) if run.isdigit() else run, "gain": None, "low": None, "high": None,
        "grade": "none", "faults": [], "position_mae": None,
        "sentence": f"No verdict: {why}", "notes": [],
    }  # fmt: skip


def row_of(run: Recording, found: Identification, twin: Calibration) -> dict[str, Any]:
    """What is said of a run."""
    low, high = found.intervals["gain"]
    label = run.labels.get("run", run.name)
    return {
        "run": int(label) if label.isdigit() else label,
        "gain": found.values["gain"],
        "low": low,
        "high": high,
        "grade": found.verdict.grade,
        "faults": list(found.verdict.faults),
        "position_mae": position_mae(run, found, twin),
        "sentence": found.verdict.sentence,
        "notes": found.warnings,
    }


def position_mae(run: Recording, found: Identification, twin: Calibration) -> float:
    """Mean error of the calibrated twin while torque is on, rad, with its likely faults.

    Nothing else is fitted to the run; false reads do not count.
    """
    comparison = twin.model.compare(run, twin.actuator)
    likely = [name for name, share in found.probabilities.items() if share > 0.5]
    faults = {name: np.array([found.values[name]]) for name in likely}
    answer = comparison.responses(faults, 1)["position"][0]
    error = np.abs(answer - comparison.measured()["position"])
    part = stretch(run, twin.actuator)
    return float(error[~part.false[part.first : part.stop]].mean())


def table(rows: list[dict[str, Any]]) -> str:
    """The rows for people."""
    lines = [f"{'run':>6}{'gain':>8}{'95 % interval':>18}{'error/mrad':>12}  verdict"]
    for row in rows:
        if row["gain"] is None:
            lines.append(f"{row['run']:>6}{'':>38}  {row['sentence']}")
            continue
        interval = f"{row['low']:.2f} to {row['high']:.2f}"
        lines.append(
            f"{row['run']:>6}{row['gain']:>8.3f}{interval:>18}"
            f"{1e3 * row['position_mae']:>12.1f}  {row['sentence']}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
