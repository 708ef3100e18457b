"""Whether intervals hold the truth where the motion is full of impacts: docs/certainty.md.

    python benchmarks/impacts.py --recordings 30 --first 100

Recordings of the reference model with a wide gap and an offset rotor, parameters known. Printed is
the share of 95 % intervals that hold the truth.
"""

import argparse
from collections.abc import Iterator, Mapping

import numpy as np

import ematwin
from counted import MAGNITUDES, NOISE, holds, table
from populations import SHEET

GROUPS: Mapping[str, tuple[str, ...]] = {
    "friction": ("friction",), "backlash": ("backlash",), "gain": ("gain",),
    "shorts": ("short_a", "short_b", "short_c"), "eccentricity": ("eccentricity",),
    "all": MAGNITUDES,
}  # fmt: skip


def faults_of(rng: np.random.Generator) -> dict[str, float]:
    """A wide gap, an offset rotor, and some of everything else."""
    return {
        "friction": 0.5 * rng.random(), "backlash": rng.uniform(0.25, 0.8),
        "short_a": 0.3 * rng.random(), "short_b": 0.0, "short_c": 0.2 * rng.random(),
        "eccentricity": rng.uniform(0.2, 0.7), "eccentricity_phase": rng.random(),
        "gain": rng.uniform(0.3, 0.7),
    }  # fmt: skip


def rows(seed: int) -> Iterator[tuple[str, bool, bool]]:
    """Fault, and whether the intervals of Laplace and of the profile hold the truth."""
    faults = faults_of(np.random.default_rng([5, seed]))
    record = ematwin.simulate("reference", faults=faults, noise=NOISE, seed=seed)
    found = ematwin.identify(record, SHEET, exact=True, threads=1, uncertainty="profile")
    assert found.uncertainty is not None
    for name in MAGNITUDES:
        ends = (found.intervals[name], found.uncertainty.intervals[name])
        held = [holds(interval, faults[name]) for interval in ends]
        yield name, held[0], held[1]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=30)
    parser.add_argument("--first", type=int, default=100, help="seed of the first recording")
    given = parser.parse_args()
    found = [
        row for seed in range(given.first, given.first + given.recordings) for row in rows(seed)
    ]
    lines = []
    for title, names in GROUPS.items():
        some = [row[1:] for row in found if row[0] in names]
        shares = [f"{share:.0f}" for share in 100.0 * np.mean(some, axis=0)]
        lines.append([f"{title} ({len(some)})", *shares])
    print(table(["95 % intervals that hold, %", "Laplace", "profile"], lines))


if __name__ == "__main__":
    main()
