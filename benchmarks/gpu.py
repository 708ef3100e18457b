"""Whether a GPU scores as the processor does, and how fast beside all of its cores.

python benchmarks/gpu.py    (a machine with a CUDA device; pip install "ematwin[gpu]")
"""

import argparse
import os
import statistics
import time
from typing import Any

import numpy as np

import ematwin
from ematwin.models.bldc.gpu import launch
from ematwin.models.bldc.model import MODEL
from ematwin.models.registry import load_actuator

FAULTS = ematwin.Faults(friction=0.4, backlash=0.3, short_a=0.2, eccentricity=0.3, gain=0.6)
REPEATS = 5
SEARCHES: dict[str, dict[str, Any]] = {
    "default search": {},
    "differential evolution, 4,096 candidates a generation": {
        "algorithm": "de", "population": 4096, "iterations": 50,
    },
}  # fmt: skip


def main() -> None:
    """Print how many scores agree, candidates a second, and seconds of an identification."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[32, 256, 2048, 16384, 131072])
    sizes = parser.parse_args().sizes
    name = launch.ready().get_current_device().name
    name = name.decode() if isinstance(name, bytes) else name
    print(f"{name}, beside {os.cpu_count()} cores")
    actuator = load_actuator("servo48")
    record = ematwin.simulate("reference", faults=FAULTS)
    there, here = (MODEL.compare(record, actuator, backend=b) for b in ("cuda", "cpu"))
    per_core, launch.CANDIDATES_PER_CORE = launch.CANDIDATES_PER_CORE, 0  # all batches here
    print("candidates   within 1e-9 / 1e-6   GPU, 1/s   processor, 1/s   ratio")
    for size in sizes:
        k = np.random.default_rng(size).random((size, 8))
        unknown = {name: k[:, n] for n, name in enumerate(FAULTS.as_dict())}
        costs, expected = there.costs(unknown, size), here.costs(unknown, size)
        rest = [np.isclose(costs, expected, rtol=r, atol=0.0).mean() for r in (1e-9, 1e-6)]
        rates = []
        for comparison in (there, here):
            spent = []
            for _ in range(REPEATS):
                start = time.perf_counter()
                comparison.costs(unknown, size)
                spent.append(time.perf_counter() - start)
            rates.append(size / statistics.median(spent))
        print(
            f"{size:>10} {100 * rest[0]:>10.2f} / {100 * rest[1]:.2f} % {rates[0]:>12.0f} "
            f"{rates[1]:>16.0f} {rates[0] / rates[1]:>7.2f}",
            flush=True,
        )
    launch.CANDIDATES_PER_CORE = per_core
    for label, settings in SEARCHES.items():
        for backend in ("cpu", "cuda"):
            spent = []
            for _ in range(3):
                start = time.perf_counter()
                ematwin.identify(record, actuator, exact=True, backend=backend, **settings)
                spent.append(time.perf_counter() - start)
            print(f"identify, {label}, {backend}: {statistics.median(spent):.2f} s", flush=True)


if __name__ == "__main__":
    main()
