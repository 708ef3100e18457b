"""How long recordings take that no twin explains: a wrong load, none, another inertia, nonsense.

    python benchmarks/poor_fits.py [--repeats 3]

Recordings of the reference model, most with 2 % noise and 12 bits. With exact parameters, and by
data sheet; seconds are medians of identifications in one process, after one that loads what is
needed. Linear algebra has one thread, as in a command.
"""

import argparse
import os
import statistics
import timeit
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read where numpy is loaded

import ematwin
from counted import NOISE
from ematwin.models.bldc.channels import PHASES


def recordings() -> dict[str, ematwin.Recording]:
    """Each with a fault in it, and something that the twin does not know."""
    worn = {"friction": 0.6, "backlash": 0.3}
    loaded = ematwin.simulate("reference", faults=worn, noise=NOISE)
    assert loaded.load is not None
    inputs = ("command", "load")
    moved = ematwin.simulate("reference", faults={"short_b": 0.2})
    sheet = ematwin.BldcActuator.load("servo48")
    heavy = sheet.changed({"motor.inertia": 1.5 * sheet.motor.inertia})
    return {
        "half of the load": loaded.changed(load=0.5 * loaded.load),
        "no load": ematwin.Recording(
            loaded.time, {name: x for name, x in loaded.channels.items() if name != "load"}
        ),
        "1.5 times the inertia": ematwin.simulate(
            "reference", faults={"friction": 0.2}, actuator=heavy, noise=NOISE
        ),
        "currents backwards": ematwin.Recording(
            moved.time,
            {name: moved.channels[name] for name in inputs}
            | {name: moved.channels[name][::-1] for name in PHASES},
        ),
    }


def main() -> None:
    """Time, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    print("| recording | parameters | s | misfit, % | verdict |\n|---|---|--:|--:|---|")
    for name, record in recordings().items():
        for parameters, exact in (("exact", True), ("data sheet", False)):
            again = partial(ematwin.identify, record, "servo48", exact=exact)
            found = again()
            spent = timeit.repeat(again, number=1, repeat=given.repeats)
            print(
                f"| {name} | {parameters} | {statistics.median(spent):.2f} |"
                f" {100.0 * found.relative_misfit:.2g} | {found.verdict.grade} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
