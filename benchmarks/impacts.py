"""Whether intervals hold the truth where the motion is full of impacts: docs/certainty.md.

    python benchmarks/impacts.py --recordings 30 --first 100

Recordings of the reference model with a wide gap and an offset rotor, parameters known. Printed is
the share of 95 % intervals that hold the truth: of Laplace, of profiles as they were walked, and of
profiles as they are given, no shorter than Laplace's where the misfit is rough.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import ematwin
from ematwin.estimation import profile
from ematwin.estimation.profile import Profiles, ProfileUncertainty
from ematwin.estimation.uncertainty import Question, Report, Uncertainty

sys.path.insert(0, str(Path(__file__).resolve().parent))
from populations import MAGNITUDES, NOISE, SHEET

GROUPS: Mapping[str, tuple[str, ...]] = {
    "friction": ("friction",), "backlash": ("backlash",), "gain": ("gain",),
    "shorts": ("short_a", "short_b", "short_c"), "eccentricity": ("eccentricity",),
    "all": MAGNITUDES,
}  # fmt: skip


@dataclass
class Both:
    """Profiles as they are given, and as they were walked."""

    name: str = "profile"
    walked: dict[str, tuple[float, float]] = field(default_factory=dict)

    def run(self, question: Question, *, seed: int, report: Report) -> Uncertainty:
        """The profiles; the intervals as walked are kept."""
        limit, profile.ROUGH = profile.ROUGH, np.inf
        try:
            self.walked = Profiles().run(question, seed=seed, report=report).intervals
        finally:
            profile.ROUGH = limit
        return Profiles().run(question, seed=seed, report=report)


def faults_of(rng: np.random.Generator) -> dict[str, float]:
    """A wide gap, an offset rotor, and some of everything else."""
    return {
        "friction": 0.5 * rng.random(), "backlash": rng.uniform(0.25, 0.8),
        "short_a": 0.3 * rng.random(), "short_b": 0.0, "short_c": 0.2 * rng.random(),
        "eccentricity": rng.uniform(0.2, 0.7), "eccentricity_phase": rng.random(),
        "gain": rng.uniform(0.3, 0.7),
    }  # fmt: skip


def rows(seed: int) -> Iterator[tuple[str, bool, bool, bool, bool]]:
    """Fault, whether it is rough, and whether Laplace, the walk and the profile hold the truth."""
    faults = faults_of(np.random.default_rng([5, seed]))
    record = ematwin.simulate("reference", faults=faults, noise=NOISE, seed=seed)
    both = Both()
    found = ematwin.identify(record, SHEET, exact=True, threads=1, uncertainty=both)
    sure = found.uncertainty
    assert isinstance(sure, ProfileUncertainty)
    for name in MAGNITUDES:
        ends = (found.intervals[name], both.walked[name], sure.intervals[name])
        held = [low - 1e-9 <= faults[name] <= high + 1e-9 for low, high in ends]
        yield name, sure.walks[name].rough, *held


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=30)
    parser.add_argument("--first", type=int, default=100, help="seed of the first recording")
    given = parser.parse_args()
    found = [
        row for seed in range(given.first, given.first + given.recordings) for row in rows(seed)
    ]
    print("| 95 % intervals that hold, % | Laplace | profile as walked | profile |")
    print("|---|--:|--:|--:|")
    groups = {title: [row for row in found if row[0] in names] for title, names in GROUPS.items()}
    groups["those that are rough"] = [row for row in found if row[1]]
    for title, some in groups.items():
        shares = [f"{100.0 * np.mean([row[n] for row in some]):.0f}" for n in (2, 3, 4)]
        print(f"| {title} ({len(some)}) | {' | '.join(shares)} |")


if __name__ == "__main__":
    main()
