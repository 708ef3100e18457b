"""Whether `ematwin.identifiability` promises what `identify` then finds: docs/identifiability.md.

    python benchmarks/identifiability.py --recordings 200

Recordings of the default command with 2 % white noise and 12 bits, one fault vector each, drawn
from the middle of the box. The error of each magnitude is set beside the standard error that was
promised at that vector, parameters known exactly: once for recordings of the twin itself, where
noise is all that is left (the factor for what the twin gets wrong taken out of the promise), and
once for those of the reference model. Printed is the root mean square of error over promise.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

import ematwin
from ematwin.models.bldc.faults import FAULTS
from ematwin.models.registry import model_of
from ematwin.recordings.noise import Noise

NOISE = Noise(white=0.02, bits=12)
MAGNITUDES = tuple(name for name in FAULTS if name != "eccentricity_phase")


def ratios(seed: int, fidelity: str) -> list[float]:
    """Error over promised standard error of each magnitude."""
    rng = np.random.default_rng([8, seed])
    faults = dict(zip(FAULTS, rng.uniform(0.1, 0.6, len(FAULTS)).tolist(), strict=True))
    record = ematwin.simulate(fidelity, faults=faults, noise=NOISE, seed=seed)
    promised = ematwin.identifiability(faults=faults, noise=NOISE, exact=True, threads=1)
    found = ematwin.identify(record, exact=True, threads=1)
    factor = 1.0
    if fidelity == "monitor":
        model = model_of(promised.actuator)
        factor = model.model_error * promised.noise / found.relative_misfit
    return [
        (found.values[name] - faults[name]) / (promised[name].error / factor) for name in MAGNITUDES
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    print(f"| recordings of | {' | '.join(MAGNITUDES)} | all |")
    print(f"|---|{'--:|' * (len(MAGNITUDES) + 1)}")
    for fidelity in ("monitor", "reference"):
        rows = Parallel(given.workers)(
            delayed(ratios)(seed, fidelity) for seed in range(given.recordings)
        )
        found = np.array(rows)
        each = np.sqrt(np.mean(found**2, axis=0))
        cells = " | ".join(f"{x:.2f}" for x in each)
        print(f"| {fidelity} | {cells} | {np.sqrt(np.mean(found**2)):.2f} |", flush=True)


if __name__ == "__main__":
    main()
