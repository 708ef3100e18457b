"""Whether `ematwin.identifiability` promises what `identify` then finds: docs/identifiability.md.

    python benchmarks/identifiability.py --recordings 200

Recordings of the default command with 2 % white noise and 12 bits, one fault vector each, drawn
from the middle of the box. The error of each magnitude is set beside the standard error that was
promised at that vector, parameters known exactly: once for recordings of the twin itself, where
noise is all that is left (the factor for what the twin gets wrong taken out of the promise), and
once for those of the reference model, beside the error that is stated and the one that is to be
expected. Printed is the root mean square of error over promise, and how many errors lie within 1.96
times the promise.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

import ematwin
from ematwin.models.bldc.faults import FAULTS
from ematwin.models.registry import model_of
from ematwin.recordings.noise import Noise

NOISE = Noise(white=0.02, bits=12)
FIDELITIES = ("monitor", "reference")
TWO = 1.96  # standard errors that hold 95 % of normal ones
OTHER = 100_000  # seeds of promises lie so far from those of recordings
MAGNITUDES = tuple(name for name in FAULTS if name != "eccentricity_phase")


def ratios(seed: int, fidelity: str) -> np.ndarray:
    """Errors of the magnitudes over the stated and over the expected ones (2, n)."""
    rng = np.random.default_rng([8, seed])
    faults = dict(zip(FAULTS, rng.uniform(0.1, 0.6, len(FAULTS)).tolist(), strict=True))
    record = ematwin.simulate(fidelity, faults=faults, noise=NOISE, seed=seed)
    # other noise than that of the recording
    promised = ematwin.identifiability(
        faults=faults, noise=NOISE, exact=True, threads=1, seed=OTHER + seed
    )
    found = ematwin.identify(record, exact=True, threads=1)
    factor = 1.0
    if fidelity == "monitor":
        model = model_of(promised.actuator)
        factor = model.model_error * promised.noise / found.relative_misfit
    errors = np.array([found.values[name] - faults[name] for name in MAGNITUDES])
    told = [promised[name] for name in MAGNITUDES]
    return np.array(
        [[factor * e / t.error, e / t.expected] for e, t in zip(errors, told, strict=True)]
    ).T


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--of", nargs="+", choices=FIDELITIES, default=FIDELITIES)
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.recordings)
    print(f"| recordings of | {' | '.join(MAGNITUDES)} | all |")
    print(f"|---|{'--:|' * (len(MAGNITUDES) + 1)}")
    for fidelity in given.of:
        rows = Parallel(given.workers)(delayed(ratios)(seed, fidelity) for seed in seeds)
        for n, kind in enumerate(("stated", "expected")):
            if (fidelity, kind) == ("monitor", "expected"):
                continue  # that is of the reference model
            found = np.array(rows)[:, n]
            each = [*np.sqrt(np.mean(found**2, axis=0)), np.sqrt(np.mean(found**2))]
            held = [*np.mean(np.abs(found) < TWO, axis=0), np.mean(np.abs(found) < TWO)]
            title = f"| {fidelity}, {kind}"
            print(f"{title} | {' | '.join(f'{x:.2f}' for x in each)} |")
            print(f"{title}: within {TWO}, % | {' | '.join(f'{100 * x:.0f}' for x in held)} |")


if __name__ == "__main__":
    main()
