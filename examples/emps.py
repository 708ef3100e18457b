"""A real linear axis: calibrate on one recording of EMPS, predict another.

EMPS, the electro-mechanical positioning system, is a carriage on a ball screw: A. Janot, M. Gautier
and M. Brunot (2019), Data Set and Reference Models of EMPS, Nonlinear System Identification
Benchmarks. The recordings are MATLAB files and not part of ematwin.

python examples/emps.py DATA_EMPS.mat
python examples/emps.py DATA_EMPS.mat --judge DATA_EMPS_PULSES.mat
python examples/emps.py DATA_EMPS.mat --judge DATA_EMPS_PULSES.mat --json
python examples/emps.py DATA_EMPS.mat --held-back    (learnt from a half, judged on the other)
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ematwin
from ematwin.errors import EmatwinError, RecordError
from ematwin.estimation.prior import Prior
from ematwin.models.linear_axis.parameters import LinearAxis
from ematwin.models.linear_axis.twin import FIRST, follow
from ematwin.models.registry import load_actuator, model_of

SIGNALS = {"t": "time", "qg": "reference", "qm": "position", "vir": "voltage"}
GAINS = {
    "gtau": "drive.gain", "kp": "controller.position_gain", "kv": "controller.velocity_gain",
}  # fmt: skip
PULSES = "pulses_N"  # in V, despite its name, and within vir already
DRAWS, SEED = 200, 1
INSIDE = 0.95
PERIOD = 6.24  # s, of the reference
# The halves of a period, s: fast forward, slow both ways, middle backward; and the other way round.
HALVES = {"upper": (1.26, 4.40), "lower": (4.40, 7.50)}
# Janot et al. (2019), asymmetric friction; the mass also with symmetric friction: 95.1089 +- 0.1085
PUBLISHED = {
    "mass": 95.154, "coulomb_forward": 20.14, "coulomb_backward": 20.63,
    "viscous_forward": 166.7, "viscous_backward": 240.4,
}  # fmt: skip
UNITS = {
    "mass": "kg", "coulomb_forward": "N", "coulomb_backward": "N", "viscous_forward": "N s/m",
    "viscous_backward": "N s/m", "standstill_ratio": "", "fading_speed": "m/s",
    "response_time": "s",
}  # fmt: skip


class Test(NamedTuple):
    """A recording, and the axis with the gains that its file gives."""

    recording: ematwin.Recording
    actuator: LinearAxis


def main() -> None:
    """Print the tables, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "estimation", nargs="?", type=Path, help="recording that the axis is learnt from"
    )
    parser.add_argument("--judge", type=Path, help="recording that is only predicted")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of tables")
    parser.add_argument(
        "--held-back", action="store_true", help="learn from a half, judge on the other"
    )
    given = parser.parse_args()
    if given.held_back and (given.json or given.judge is not None):
        parser.error(
            "--held-back takes the estimation recording alone; leave --judge and --json out"
        )
    if given.estimation is None:
        print(
            "Give the file with the estimation recording of EMPS. It is published with the "
            "nonlinear system identification benchmarks (nonlinearbenchmark.org); "
            "docs/real-recordings.md says what it holds."
        )
        return
    try:
        estimation = read_emps(given.estimation, load_actuator("emps"))
        judge = None if given.judge is None else read_emps(given.judge, estimation.actuator)
        if given.held_back:
            held_back(estimation)
            return
        found = learnt(estimation, judge)
    except EmatwinError as error:
        sys.exit(str(error))
    if given.json:
        print(json.dumps(found, indent=2))
    else:
        print(table(found))


def read_emps(path: Path, actuator: Any) -> Test:
    """A recording of the benchmark; gains that its file does not give are the actuator's.

    Raises
    ------
    RecordError
        If the file cannot be read, a variable is missing, or it is no recording of such an axis.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    if not path.is_file():
        raise RecordError(f"There is no file {path}. Give the MATLAB file of the benchmark.")
    try:
        content = loadmat(path)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be read: {error.strerror or error}. Give the MATLAB file of the "
            "benchmark."
        ) from None
    except (ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise RecordError(
            f"{path} is no MATLAB 5 file ({error}). Give the MATLAB file of the benchmark."
        ) from None
    missing = [name for name in SIGNALS if name not in content]
    if missing:
        wanted = ", ".join(f"{name} ({SIGNALS[name]})" for name in missing)
        held = ", ".join(name for name in content if not name.startswith("__")) or "nothing"
        raise RecordError(f"{path} lacks {wanted}; it holds {held}. Give a recording of EMPS.")
    channels = {meaning: column(content, name, path) for name, meaning in SIGNALS.items()}
    if PULSES in content:
        channels["pulses"] = column(content, PULSES, path)
    gains = {place: gain(content, name, path) for name, place in GAINS.items() if name in content}
    recording = ematwin.Recording(channels.pop("time"), channels, source=str(path))
    own = actuator.changed(gains)
    for warning in model_of(own).check(recording, own):
        print(f"Warning: {warning}", file=sys.stderr)
    return Test(recording, own)


def column(content: dict[str, Any], name: str, path: Path) -> np.ndarray:
    """A variable as (S,) numbers."""
    values = np.asarray(content[name])
    if values.dtype.kind not in "biuf" or values.size != max(values.shape, default=0):
        raise RecordError(
            f"{path}: {name} must be one column of numbers, received an array of {values.dtype} "
            f"with the shape {values.shape}. Give a recording of EMPS."
        )
    return np.asarray(values, dtype=float).ravel()


def gain(content: dict[str, Any], name: str, path: Path) -> float:
    """A variable as one number."""
    values = column(content, name, path)
    if values.size != 1 or not np.isfinite(values).all():
        raise RecordError(
            f"{path}: {name} must be one finite number, received {values.size} values. Give a "
            "recording of EMPS."
        )
    return float(values[0])


def learnt(estimation: Test, judge: Test | None) -> dict[str, Any]:
    """Parameters from the first recording alone, and the scores of both."""
    report = ematwin.calibrate([estimation.recording], estimation.actuator)
    axis, known = report.actuator, report.baseline
    found = {
        "parameters": parameters(axis, known.prior),
        "estimation": scores(estimation.recording, axis, known.prior),
        "judge": None,
    }
    if judge is not None:
        own = {place: judge.actuator.value(place) for place in GAINS.values()}
        later = known.drifted(axis)  # friction may have changed since
        found["judge"] = scores(judge.recording, axis.changed(own), later)
    return found


def drawn(prior: Prior) -> dict[str, np.ndarray]:
    """Parameters (DRAWS,) by place, as likely as the estimation makes them."""
    random = np.random.default_rng(SEED)
    values = np.exp(random.multivariate_normal(prior.mean, prior.covariance, DRAWS))
    return dict(zip(prior.names, values.T, strict=True))


def physical(values: dict[str, Any]) -> dict[str, Any]:
    """The parameters as they are published: friction of each direction."""
    dry, viscous = (np.sqrt(values[f"friction.{n}_ratio"]) for n in ("coulomb", "viscous"))
    return {
        "mass": values["carriage.mass"],
        "coulomb_forward": values["friction.coulomb"] / dry,
        "coulomb_backward": values["friction.coulomb"] * dry,
        "viscous_forward": values["friction.viscous"] / viscous,
        "viscous_backward": values["friction.viscous"] * viscous,
        "standstill_ratio": values["friction.standstill_ratio"],
        "fading_speed": values["friction.fading_speed"],
        "response_time": values["drive.response_time"],
    }


def parameters(axis: LinearAxis, prior: Prior) -> dict[str, Any]:
    """Value, 95 % interval and published value of each parameter."""
    best = physical({place: axis.value(place) for place in prior.names})
    spread = physical(drawn(prior))
    found = {}
    for name, unit in UNITS.items():
        low, high = ends(spread[name])
        found[name] = {
            "value": float(best[name]), "low": float(low), "high": float(high), "unit": unit,
            "published": PUBLISHED.get(name),
        }  # fmt: skip
    return found


def ends(values: np.ndarray) -> Any:
    """Ends of the interval that holds 95 % of values (N, ...), each (...)."""
    return np.quantile(values, [0.5 - 0.5 * INSIDE, 0.5 + 0.5 * INSIDE], axis=0)


def scores(recording: ematwin.Recording, axis: LinearAxis, prior: Prior) -> dict[str, Any]:
    """How far simulation and recording are apart, and how often its interval holds the truth."""
    twin = follow(axis, recording, {}, 1)
    alone = follow(axis, recording, {}, 1, closed=False)["position"][0]
    many = follow(axis, recording, drawn(prior), DRAWS, closed=False)["position"]
    low, high = ends(many)
    truth = recording.position
    # the interval stands around the best parameters, of which the draws have the spread
    centre = 0.5 * (low + high)
    low, high = low + alone - centre, high + alone - centre
    after = slice(FIRST, None)
    return {
        "force_percent": relative(twin["voltage"][0], recording.voltage),
        "position_percent": relative(twin["position"][0], truth),
        "open_loop_rmse_mm": 1e3 * float(np.sqrt(np.mean((alone - truth)[after] ** 2))),
        "open_loop_interval": {
            "half_width_mm": 1e3 * float(np.mean(0.5 * (high - low)[after])),
            "inside_percent": 100.0 * float(np.mean(((truth >= low) & (truth <= high))[after])),
        },
    }


def relative(simulated: np.ndarray, recorded: np.ndarray) -> float:
    """100 |simulated - recorded| / |recorded|, %; forces and voltages have the same."""
    return 100.0 * float(np.linalg.norm(simulated - recorded) / np.linalg.norm(recorded))


def table(found: dict[str, Any]) -> str:
    """Parameters and scores for people."""
    lines = [f"{'':<18}{'value':>10}{'95 % interval':>22}{'published':>12}"]
    for name, row in found["parameters"].items():
        interval = f"{row['low']:.4g} to {row['high']:.4g}"
        published = "" if row["published"] is None else f"{row['published']:.5g}"
        title = name.replace("_", " ")
        lines.append(f"{title:<18}{row['value']:>10.4g}{interval:>22}{published:>12} {row['unit']}")
    lines += [
        "",
        f"{'':<18}{'force':>10}{'position':>12}{'open loop, RMSE':>18}{'95 % interval':>18}",
    ]
    for title in ("estimation", "judge"):
        row = found[title]
        if row is not None:
            band = row["open_loop_interval"]
            inside = f"{band['inside_percent']:.0f} % inside"
            lines.append(
                f"{title:<18}{row['force_percent']:>8.2f} %{row['position_percent']:>10.5f} %"
                f"{row['open_loop_rmse_mm']:>15.2f} mm   +-{band['half_width_mm']:.1f} mm, {inside}"
            )
    return "\n".join(lines)


def held_back(test: Test) -> None:
    """Each half of the first period judges the other half of all periods, then the whole recording.

    One half moves forward at its fastest and backward at the middle speed, the other the other way
    round, over the same places; every part is a recording of its own, simulated from its first
    samples on. Of the whole recording an eighth was learnt from.
    """
    columns = ("judged", "mass", "force", "position", "open loop", "interval", "inside")
    print(f"{'learnt from':<14}" + "".join(f"{title:>15}" for title in columns))
    for half, other in (("upper", "lower"), ("lower", "upper")):
        report = ematwin.calibrate(parts(test, half)[:1], test.actuator)
        axis, prior = report.actuator, report.baseline.prior
        mass = parameters(axis, prior)["mass"]
        for part in (*parts(test, other), test.recording):
            title = f"{part.time[-1] - part.time[0]:.1f} s"
            row = scores(part, axis, prior)
            band = row["open_loop_interval"]
            interval = f"{mass['low']:.1f}-{mass['high']:.1f} kg"
            print(
                f"{half:<14}{title:>15}{interval:>15}{row['force_percent']:>13.2f} %"
                f"{row['position_percent']:>13.5f} %{row['open_loop_rmse_mm']:>12.2f} mm"
                f"{band['half_width_mm']:>12.1f} mm{band['inside_percent']:>13.0f} %"
            )


def parts(test: Test, half: str) -> list[ematwin.Recording]:
    """One half of each period."""
    recording, end = test.recording, float(test.recording.time[-1])
    low, high = HALVES[half]
    starts = [start for start in np.arange(0.0, end, PERIOD) if start + high <= end]
    if not starts:
        raise RecordError(
            f"{recording.name} lasts {end:.3g} s; a held-back half ends at {high:g} s. Give the "
            "whole estimation recording."
        )
    return [recording.between(start + low, start + high) for start in starts]


if __name__ == "__main__":
    main()
