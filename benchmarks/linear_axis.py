"""How often the intervals of a calibrated linear axis hold the truth, on axes that the twin is not.

Each axis is drawn at random and simulated by tests/made_up_emps.py, which shares no code with the
twin: bristles, friction that swings with the position and drifts, an encoder that counts, and
pulses in the recording that is only predicted.

    python benchmarks/linear_axis.py [--axes 16] [--first 0]
    python benchmarks/linear_axis.py --verdicts [--axes 12]    (sound and worn, against a template)
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import ematwin
from ematwin.estimation.constants import COVERAGE
from ematwin.models.registry import load_actuator

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "examples")]

import emps  # noqa: E402

import made_up_emps as made_up  # noqa: E402

PERIODS = 4
WORN = 1.4  # viscous friction backward over forward


def main() -> None:
    """Print a row for each axis, and the shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--axes", type=int, default=16)
    parser.add_argument("--first", type=int, default=0, help="seed of the first axis")
    parser.add_argument("--verdicts", action="store_true", help="identify, not calibrate")
    given = parser.parse_args()
    if given.verdicts:
        verdicts(given.first, given.axes)
        return
    errors: dict[str, list[float]] = {}  # over their standard errors
    predicted = []
    print(f"{'axis':<6}{'mass off':>10}{'force':>16}{'open loop':>12}{'interval':>12}{'inside':>9}")
    for seed in range(given.first, given.first + given.axes):
        axis = made_up.any_axis(seed)
        tests = [test(axis, pulses) for pulses in (False, True)]
        found = emps.learnt(*tests)
        for name, true in truth(axis).items():
            row = found["parameters"][name]
            error = (row["value"] - true) / (row["high"] - row["low"])
            errors.setdefault(name, []).append(2.0 * COVERAGE * error)
        judge = found["judge"]
        band = judge["open_loop_interval"]
        predicted.append(band["inside_percent"])
        off = 100.0 * (found["parameters"]["mass"]["value"] / axis.mass - 1.0)
        force = f"{found['estimation']['force_percent']:.1f} / {judge['force_percent']:.1f} %"
        print(
            f"{seed:<6}{off:>8.2f} %{force:>16}{judge['open_loop_rmse_mm']:>9.2f} mm"
            f"{band['half_width_mm']:>9.1f} mm{band['inside_percent']:>7.0f} %",
            flush=True,
        )
    print(f"\n{'':<18}{'inside 95 %':>14}{'error over standard error, RMS':>34}")
    for name, found in errors.items():
        inside = 100.0 * np.mean(np.abs(found) <= COVERAGE)
        print(f"{name:<18}{inside:>12.0f} %{np.sqrt(np.mean(np.square(found))):>34.2f}")
    print(f"{'open loop':<18}{np.mean(predicted):>12.0f} %")


def verdicts(first: int, axes: int) -> None:
    """What `identify` says of axes of which every third has a worn screw.

    Against the symmetric template of EMPS, with the axis's own mass within 2 %.
    """
    for seed in range(first, first + axes):
        axis, ratio = made_up.any_axis(seed), WORN if seed % 3 == 2 else 1.0
        dry, viscous = (float(np.prod(both)) ** 0.5 for both in (axis.coulomb, axis.viscous))
        axis = axis._replace(
            coulomb=(dry, dry), viscous=(viscous / ratio**0.5, viscous * ratio**0.5)
        )
        recording, own = test(axis, pulses=False)
        off = float(np.exp(np.random.default_rng(seed).normal(0.0, 0.02)))
        gains = {place: own.value(place) for place in emps.GAINS.values()}
        template = load_actuator("emps-symmetric").changed(
            {"carriage.mass": off * axis.mass, **gains}
        )
        found = ematwin.identify(recording, template)
        said = ", ".join(found.verdict.faults) or found.verdict.grade
        value, (low, high) = found.contrasts["asymmetry"]
        screw = "worn" if ratio > 1.0 else "sound"
        print(f"{seed:<4}{screw:<8}{said:<20} asymmetry {value:.2f} ({low:.2f} to {high:.2f})")


def test(axis: made_up.Axis, pulses: bool) -> emps.Test:
    """A recording of an axis with the gains that it states."""
    content = made_up.recorded(PERIODS, pulses, axis)
    names = {**emps.SIGNALS, **({emps.PULSES: "pulses"} if pulses else {})}
    channels = {meaning: content[name].ravel() for name, meaning in names.items()}
    gains = {place: float(content[name][0, 0]) for name, place in emps.GAINS.items()}
    own = load_actuator("emps").changed(gains)
    return emps.Test(ematwin.Recording(channels.pop("time"), channels), own)


def truth(axis: made_up.Axis) -> dict[str, float]:
    """What is known of it that the twin also has."""
    return {
        "mass": axis.mass,
        "coulomb_forward": axis.coulomb[0], "coulomb_backward": axis.coulomb[1],
        "viscous_forward": axis.viscous[0], "viscous_backward": axis.viscous[1],
    }  # fmt: skip


if __name__ == "__main__":
    main()
