"""How well faults are found: the figures of docs/results.md.

    python benchmarks/identification.py --paper --algorithms multistart,ga,pso,de,gwo,da,woa
    python benchmarks/identification.py --several 50 --seed 2026
    python benchmarks/identification.py --several 50 --seed 2026 --noise white=0.02,bits=12
    python benchmarks/identification.py --near-stall 60 --seed 201
    python benchmarks/identification.py --coverage

Records come from the reference model with the default actuator and scenario; they are identified
with the monitor model. Each prints a Markdown table; `--json` prints the runs.
"""

import argparse
import json
import sys
from statistics import fmean
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from counted import table
from ematwin import Faults, Noise, identify, simulate
from ematwin.models.bldc.faults import (
    FAULTS,
    HEALTHY,
    PAPER_CASES,
    error_percent,
    error_percent_wrapped,
)

Run = dict[str, Any]


def random_faults(count: int, seed: int, least: int = 3, most: int = 8) -> list[Faults]:
    """Vectors with ``least`` to ``most`` faults, each magnitude uniform in [0, 1]."""
    rng = np.random.default_rng(seed)
    vectors = []
    for _ in range(count):
        k = HEALTHY.copy()
        chosen = rng.choice(len(FAULTS), rng.integers(least, most + 1), replace=False)
        k[chosen] = rng.random(len(chosen))
        vectors.append(Faults.of(k))
    return vectors


def near_stall(count: int, seed: int) -> list[Faults]:
    """Of such vectors those with a phase nearly lost, and a second one or most of the air gap."""
    found: list[Faults] = []
    while len(found) < count:
        for faults in random_faults(100, seed):
            shorts = sorted((faults.short_a, faults.short_b, faults.short_c))
            if shorts[2] > 0.9 and (shorts[1] > 0.85 or faults.eccentricity > 0.85):
                found.append(faults)
        seed += 1
    return found[:count]


def one_run(case: str, injected: Faults, algorithm: str, seed: int, noise: Noise | None) -> Run:
    """Simulate, identify, compare."""
    record = simulate("reference", faults=injected, noise=noise, seed=seed)
    found = identify(record, algorithm=algorithm, seed=seed, threads=1, exact=True)
    errors = [found.standard_error[name] for name in FAULTS]
    return {
        "case": case,
        "algorithm": algorithm,
        "seed": seed,
        "injected": injected.vector.tolist(),
        "found": found.faults.vector.tolist(),
        "standard_error": errors,
        "err": float(error_percent(found.faults.vector, injected.vector)),
        "err_wrapped": float(error_percent_wrapped(found.faults.vector, injected.vector)),
        "relative_misfit": found.relative_misfit,
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "stopped": found.stopped,
    }


def runs_of(tasks: list[tuple[Any, ...]], workers: int) -> list[Run]:
    """A run for each task, the arguments of `one_run`; with a line of progress on a terminal."""
    done: list[Run] = []
    for run in Parallel(workers, return_as="generator")(delayed(one_run)(*task) for task in tasks):
        done.append(run)
        if sys.stderr.isatty():
            print(f"\r{len(done)}/{len(tasks)} runs", end="", file=sys.stderr)
    return done


def paper_table(runs: list[Run], algorithms: list[str]) -> str:
    """Mean Err% of each case and algorithm."""

    def values(key: str, algorithm: str, case: str | None = None) -> list[float]:
        own = [run for run in runs if run["algorithm"] == algorithm]
        return [run[key] for run in own if case in (None, run["case"])]

    rows = [
        [case, *(f"{fmean(values('err_wrapped', a, case)):.2f}" for a in algorithms)]
        for case in PAPER_CASES
    ]
    for title, key, summary, digits in (
        ("mean, paper's Err%", "err", fmean, 2),
        ("worst run, paper's Err%", "err", max, 2),
        ("mean simulations", "evaluations", fmean, 0),
    ):
        rows.append([title, *(f"{summary(values(key, a)):.{digits}f}" for a in algorithms)])
    caught = [sum(err > 1.0 for err in values("err_wrapped", a)) for a in algorithms]
    return table(["case", *algorithms], [*rows, ["runs above 1, phase wrapped", *caught]])


def several_table(runs: list[Run]) -> str:
    """Quantiles of Err% over the vectors."""
    rows = []
    for title, key in (("paper's Err%", "err"), ("phase wrapped", "err_wrapped")):
        e = np.array([run[key] for run in runs])
        above = [f"{np.sum(e > limit)} of {e.size}" for limit in (1, 5)]
        rows.append(
            [title, f"{np.median(e):.2f}", f"{np.percentile(e, 90):.2f}", f"{e.max():.1f}", *above]
        )
    lines = [table(["", "median", "90th percentile", "worst", "above 1", "above 5"], rows), ""]
    cost = np.array([run["evaluations"] for run in runs])
    lines.append(
        f"simulations: mean {cost.mean():.0f}, median {np.median(cost):.0f}, most {cost.max():.0f}"
    )
    for run in runs:
        if run["err_wrapped"] > 1.0:
            injected = np.round(run["injected"], 2).tolist()
            lines.append(
                f"- {run['case']} {injected}: Err% {run['err_wrapped']:.1f}, "
                f"misfit {100 * run['relative_misfit']:.2f} %, stopped: {run['stopped']}"
            )
    return "\n".join(lines)


def coverage_table(runs: list[Run]) -> str:
    """How often the truth lies within 1, 2 and 3 standard errors."""
    z = []
    for run in runs:
        k, found = np.array(run["injected"]), np.array(run["found"])
        error = np.array(run["standard_error"], dtype=float)
        inside = (k > 0.01) & (k < 0.99)  # at a bound an error has one side only
        inside[6] = k[5] > 0.1
        gap = found - k
        gap[6] -= np.round(gap[6])
        z.extend((np.abs(gap) / error)[inside & np.isfinite(error)])
    z = np.array(z)
    cells = [f"{100 * np.mean(z < n):.0f} %" for n in (1, 2, 3)]
    return (
        "| within 1 | within 2 | within 3 standard errors | components |\n|--:|--:|--:|--:|\n"
        f"| {cells[0]} | {cells[1]} | {cells[2]} | {z.size} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--paper", action="store_true", help="the ten vectors of Table 1")
    what.add_argument(
        "--several", type=int, metavar="N", help="N random vectors with 3 to 8 faults"
    )
    what.add_argument(
        "--near-stall", type=int, metavar="N", help="N such vectors near the torque at stall"
    )
    what.add_argument("--coverage", action="store_true", help="are the standard errors honest?")
    parser.add_argument("--algorithms", default="multistart")
    parser.add_argument("--seeds", type=int, default=10, help="repetitions of each case")
    parser.add_argument("--first", type=int, default=1, help="seed of the first repetition")
    parser.add_argument("--seed", type=int, default=2026, help="of the random vectors")
    parser.add_argument("--most", type=float, default=1.0, help="largest magnitude of a fault")
    parser.add_argument("--noise", type=Noise.parse, default=None)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    algorithms = options.algorithms.split(",")
    if options.paper:
        tasks = [
            (case, Faults(**values), algorithm, seed, options.noise)
            for algorithm in algorithms
            for case, values in PAPER_CASES.items()
            for seed in range(options.first, options.first + options.seeds)
        ]
        runs = runs_of(tasks, options.workers)
        text = paper_table(runs, algorithms)
    else:
        if options.near_stall:
            vectors = near_stall(options.near_stall, options.seed)
        else:
            vectors = random_faults(options.several or 100, options.seed)
        if options.most < 1.0:
            scaled = [v.vector * np.where(HEALTHY == 0.0, options.most, 1.0) for v in vectors]
            vectors = [Faults.of(k) for k in scaled]
        tasks = [
            (f"vector {n}", injected, algorithms[0], n + 1, options.noise)
            for n, injected in enumerate(vectors)
        ]
        runs = runs_of(tasks, options.workers)
        text = coverage_table(runs) if options.coverage else several_table(runs)
    print(json.dumps(runs) if options.json else text)


if __name__ == "__main__":
    main()
