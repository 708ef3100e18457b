"""Costs in single precision beside those in double: how far apart they are, and how much sooner.

    python benchmarks/single.py [--count 20000] [--seed 11] [--json]

Fault vectors anywhere in the box, and near the truth, against a recording of the reference model.
Beside it stands what rounding in double precision does when a fault is moved by 1e-7 of its range:
where candidates tumble from wall to wall of the gap, that is as much.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np

from ematwin import Faults, simulate
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.unknowns import FAULTS

TRUTH = Faults(friction=0.2, backlash=0.1, short_b=0.15, eccentricity=0.2, gain=0.6)
_MOVED = 1e-7
_QUANTILES = (0.5, 0.9, 0.99, 1.0)


def main() -> None:
    """Run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20_000, help="fault vectors of each kind")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--repeats", type=int, default=7, help="turns that are timed")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    actuator, recording = BldcActuator.load(), simulate("reference", faults=TRUTH)
    double = BldcComparison(recording, actuator)
    single = BldcComparison(recording, actuator, backend="cpu-single")

    def misfits(comparison: BldcComparison, k: np.ndarray) -> np.ndarray:
        costs = comparison.costs(dict(zip(FAULTS, k.T, strict=True)), len(k))
        return np.asarray(100.0 * np.sqrt(costs / comparison.scale))

    rng = np.random.default_rng(given.seed)
    truth = np.array(TRUTH.vector)

    def near(spread: float) -> np.ndarray:
        away = spread * rng.standard_normal((given.count, len(FAULTS)))
        return np.clip(truth + away, 0.0, 1.0)

    rows = []
    for title, k in (
        ("anywhere", rng.random((given.count, len(FAULTS)))),
        ("0.02 from the truth", near(0.02)),
        ("0.002 from the truth", near(0.002)),
    ):
        exact = misfits(double, k)
        moved = np.clip(k + _MOVED * rng.standard_normal(k.shape), 0.0, 1.0)
        apart = np.abs(misfits(single, k) - exact)
        beside = np.abs(misfits(double, moved) - exact)
        for low, high in ((0.0, 200.0), (200.0, np.inf)):
            some = (exact >= low) & (exact < high)
            if some.any():
                rows.append({
                    "vectors": title + (", misfit above 200 %" if low else ""),
                    "count": int(some.sum()),
                    "misfit": float(np.median(exact[some])),
                    "single": np.quantile(apart[some], _QUANTILES).tolist(),
                    "moved": np.quantile(beside[some], _QUANTILES).tolist(),
                })  # fmt: skip
    batch = rng.random((50, len(FAULTS)))

    def seconds(work: Callable[[], object]) -> float:
        start = time.perf_counter()
        for _ in range(200):
            work()
        return time.perf_counter() - start

    turns = [
        (seconds(lambda: misfits(double, batch)), seconds(lambda: misfits(single, batch)))
        for _ in range(given.repeats)
    ]
    times = {
        "double": statistics.median(a for a, _ in turns),
        "single": statistics.median(b for _, b in turns),
        "ratio": statistics.median(a / b for a, b in turns),
    }
    if given.json:
        print(json.dumps({"misfits": rows, "ten_thousand_scorings_s": times}, indent=2))
        return
    print(
        "| fault vectors | count | misfit, % | single and double apart, % of the current: median, "
        "90 %, 99 %, worst | a fault moved by 1e-7, double |"
    )
    print("|---|--:|--:|--:|--:|")
    for row in rows:
        apart, beside = (" / ".join(f"{x:.2g}" for x in row[each]) for each in ("single", "moved"))
        print(f"| {row['vectors']} | {row['count']} | {row['misfit']:.2g} | {apart} | {beside} |")
    print(
        f"\n10,000 scorings in batches of 50, all cores, medians of {given.repeats} turns: "
        f"{times['double']:.2f} s in double, {times['single']:.2f} s in single precision, "
        f"{times['ratio']:.2f} times"
    )


if __name__ == "__main__":
    main()
