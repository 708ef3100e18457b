"""How much of the machine the lanes of the monitor model use: operations, seconds, share of peak.

    python benchmarks/roofline.py [--figure roofline.svg]

Operations are counted in the machine code of the loop over the lanes, as compiled here; peak is
what a loop of nothing but fused multiply-adds reaches on the same core, memory bandwidth that of a
copy of arrays that no cache holds. One thread. The figure needs matplotlib (extra ``study``).
"""

# ruff: noqa: E402

import argparse
import os
import re
import tempfile
import timeit
from collections import Counter
from collections.abc import Callable
from pathlib import Path

_FOLDER = tempfile.TemporaryDirectory()
os.environ["NUMBA_CACHE_DIR"] = _FOLDER.name  # machine code is kept as text only when it is made

import numpy as np

import ematwin
from ematwin.models.bldc import batch
from ematwin.models.bldc.comparison import BldcComparison
from ematwin.models.bldc.faults import UNKNOWNS
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.numerics.compile import loop
from ematwin.numerics.lanes import LANES, lane_loop, wide_vectors

_CHAIN = 12  # multiply-adds between a load and a store
_VALUES = 512  # in the fastest cache
_CLASSES = {
    "multiply-add": r"vfn?m(add|sub)\d+pd",
    "add, multiply": r"v(add|sub|mul)pd",
    "divide": r"v(div|sqrt)pd",
    "compare, select, round": r"v(cmp\w*|min|max|blendv?m?|andn?|x?or|rndscale|round)pd|vpternlogq",
    "move": r"vmov[ua]pd|vbroadcastsd",
}
_FLOPS = {"multiply-add": 2, "add, multiply": 1, "divide": 1}


@lane_loop
def multiply_adds(values, factor, summand, count):
    """``values`` times ``factor`` plus ``summand``, `_CHAIN` times in a row, so many times."""
    wide_vectors()
    for _ in range(count):
        for n in range(values.size):
            x = values[n]
            for _ in range(_CHAIN):
                x = x * factor + summand
            values[n] = x


@loop
def copy(source, target):
    """Copy an array, to use the memory and nothing else."""
    wide_vectors()
    for n in range(source.size):
        target[n] = source[n] + 1.0


def fastest(work: Callable[[], object], repeats: int = 9) -> float:
    """Seconds of the fastest of some calls, after a first."""
    work()
    return min(timeit.repeat(work, number=1, repeat=repeats))


def over_lanes(code: str) -> tuple[Counter[str], int]:
    """Instructions of the loop over the lanes by class, and how many vectors one pass takes."""
    blocks = re.split(r"(?m)^\.?L[\w.$]*:", code)
    widest = max(blocks, key=lambda block: len(re.findall(r"\tv\w+pd\t", block)))
    found: Counter[str] = Counter()
    for name in re.findall(r"(?m)^\t(v\w+)\t.*[yz]mm", widest):
        for title, pattern in _CLASSES.items():
            if re.fullmatch(pattern, name):
                found[title] += 1
                break
    return found, max(1, found["divide"] // _DIVISIONS)


_DIVISIONS = 3  # of a step: the current's reference, the instant of an impact and that of rest


def measure() -> dict[str, float]:
    """All figures."""
    record = ematwin.simulate("reference", faults={"friction": 0.25})
    comparison = BldcComparison(record, BldcActuator.load(), threads=1)
    rng = np.random.default_rng(1)
    count = 4 * LANES
    batch.monitor_scores = scores = lane_loop(batch.monitor_scores.py_func)
    candidates = {one.name: rng.uniform(one.lower, one.upper, count) for one in UNKNOWNS}
    seconds = fastest(lambda: comparison.costs(candidates, count))
    steps = count * comparison.substeps * (len(record) - 1)
    code = scores.inspect_asm(scores.signatures[0])
    found, vectors = over_lanes(code)
    each = sum(_FLOPS.get(title, 0) * number for title, number in found.items()) / vectors
    values, rounds = np.ones(_VALUES), 10_000
    adds = _CHAIN * _VALUES * rounds
    peak = 2.0 * adds / fastest(lambda: multiply_adds(values, 0.5, 0.5, rounds))
    large = np.ones(16_000_000)
    target = np.empty_like(large)
    bandwidth = 2.0 * large.nbytes / fastest(lambda: copy(large, target), 3)
    traffic = 4 * 8.0 / (LANES * comparison.substeps)  # inputs and target, by each block
    return {
        **{f"instructions, {title}": float(number) for title, number in found.items()},
        "vectors of a pass": float(vectors),
        "ns a candidate-step": 1e9 * seconds / steps,
        "flop a candidate-step": float(each),
        "Gflop/s": each * steps / seconds / 1e9,
        "peak Gflop/s": peak / 1e9,
        "share of peak": each * steps / seconds / peak,
        "flop a byte": each / traffic,
        "GB/s": bandwidth / 1e9,
    }


def draw(found: dict[str, float], path: Path) -> None:
    """The roofline, with the lanes on it."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    peak, bandwidth = found["peak Gflop/s"], found["GB/s"]
    figure, axes = plt.subplots(figsize=(7.0, 4.0))
    intensity = np.logspace(-2, 4, 200)
    axes.loglog(intensity, np.minimum(peak, bandwidth * intensity), color="0.3")
    axes.plot(found["flop a byte"], found["Gflop/s"], "o", color="tab:orange")
    axes.annotate(
        f"lanes of the monitor model\n{100 * found['share of peak']:.0f} % of peak",
        (found["flop a byte"], found["Gflop/s"]), xytext=(-10, -12), textcoords="offset points",
        ha="right", va="top",
    )  # fmt: skip
    axes.annotate(f"{peak:.0f} Gflop/s, multiply-adds alone", (2e2, peak), xytext=(0, 5),
                  textcoords="offset points", ha="right")  # fmt: skip
    axes.annotate(f"{bandwidth:.0f} GB/s from memory", (0.1, 0.1 * bandwidth), xytext=(8, -8),
                  textcoords="offset points", va="top")  # fmt: skip
    axes.set(xlabel="flop a byte of memory", ylabel="Gflop/s, one thread", ylim=(0.1, 3 * peak))
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figure", type=Path, metavar="FILE.svg")
    options = parser.parse_args()
    found = measure()
    for title, number in found.items():
        print(f"{title:38} {number:10.3g}")
    if options.figure is not None:
        draw(found, options.figure)


if __name__ == "__main__":
    main()
