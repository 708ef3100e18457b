"""Whether `ematwin.identifiability` promises what `identify` then finds: docs/identifiability.md.

    python benchmarks/identifiability.py --recordings 200

Recordings of the default command with 2 % white noise and 12 bits, one fault vector each, drawn
from the middle of the box. The error of each magnitude is set beside the standard error that was
promised at that vector, parameters known exactly. Printed is the root mean square of error over
promise, and how many errors lie within 1.96 times the promise.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

import ematwin
from counted import MAGNITUDES, NOISE, table
from ematwin.estimation.constants import COVERAGE
from ematwin.models.bldc.faults import FAULTS

OTHER = 100_000  # seeds of promises lie so far from those of recordings


def ratios(seed: int) -> np.ndarray:
    """Errors of the magnitudes over those that were promised (n,)."""
    rng = np.random.default_rng([8, seed])
    faults = dict(zip(FAULTS, rng.uniform(0.1, 0.6, len(FAULTS)).tolist(), strict=True))
    record = ematwin.simulate("reference", faults=faults, noise=NOISE, seed=seed)
    # other noise than that of the recording
    promised = ematwin.identifiability(
        faults=faults, noise=NOISE, exact=True, threads=1, seed=OTHER + seed
    )
    found = ematwin.identify(record, exact=True, threads=1)
    return np.array(
        [(found.values[name] - faults[name]) / promised[name].error for name in MAGNITUDES]
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.recordings)
    found = np.array(Parallel(given.workers)(delayed(ratios)(seed) for seed in seeds))
    each = [*np.sqrt(np.mean(found**2, axis=0)), np.sqrt(np.mean(found**2))]
    held = [*np.mean(np.abs(found) < COVERAGE, axis=0), np.mean(np.abs(found) < COVERAGE)]
    rows = [
        ["error over promise", *(f"{x:.2f}" for x in each)],
        [f"within {COVERAGE}, %", *(f"{100 * x:.0f}" for x in held)],
    ]
    print(table(["", *MAGNITUDES, "all"], rows))


if __name__ == "__main__":
    main()
