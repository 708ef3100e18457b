"""ematwin beside its peers, measured in one run.

    python benchmarks/peers                          all parts
    python benchmarks/peers simulators optimisers    some of them
    python benchmarks/peers --page peers.html        also as a page with plots
    python benchmarks/peers --quick                  small sizes: does it all run?

simulators      the monitor model in numpy, numba, scipy, JAX and C++
ngspice         the same electrics in a circuit simulator
identification  the same recordings identified by pyPESTO, PINTS, DFO-LS, scipy and cma
optimisers      the own time of population methods
uncertainty     profiles and posterior of pyPESTO on the same density

Peers beside numpy, scipy and numba: pip install "jax[cpu]" DFO-LS pints pypesto fides pymoo pygmo
cma nevergrad; programs: g++, ngspice. What is missing is left out, and said. Run it on a machine
that does nothing else.
"""

import argparse
import importlib
import os
import sys
from pathlib import Path

PARTS = ("simulators", "ngspice", "identification", "optimisers", "uncertainty")


def main() -> int:
    """Run the parts; 130 if interrupted."""
    from benchmarks.peers.measure import Part, end_progress
    from benchmarks.peers.page import footer, markdown, page

    parser = argparse.ArgumentParser(
        prog="python benchmarks/peers", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--repeats", type=int, default=5, help="of each figure (default 5)")
    parser.add_argument("--quick", action="store_true", help="small sizes, two repeats")
    parser.add_argument("--page", type=Path, metavar="FILE.html", help="also write a page")
    options = parser.parse_args()
    unknown = [name for name in options.parts if name not in PARTS]
    if unknown:
        parser.error(f"there is no part {unknown[0]!r}; choose from {', '.join(PARTS)}.")
    if options.repeats < 1:
        parser.error(f"--repeats must be at least 1, received {options.repeats}.")
    repeats = 2 if options.quick else options.repeats
    done: list[Part] = []
    interrupted = False
    try:
        for name in options.parts or PARTS:
            module = importlib.import_module(f"benchmarks.peers.{name}")
            part = module.run(quick=options.quick, repeats=repeats)
            end_progress()
            print(markdown(part), end="\n\n", flush=True)
            done.append(part)
    except KeyboardInterrupt:
        end_progress()
        print("Interrupted: parts that were finished are shown.", file=sys.stderr)
        interrupted = True
    if done:
        print(footer(done))
    if options.page is not None and done:
        options.page.write_text(page(done), encoding="utf-8")
        print(f"Page: {options.page}", file=sys.stderr)
    return 130 if interrupted else 0


if __name__ == "__main__":
    # One thread for linear algebra: least squares of others would else wait for busy cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Python puts this folder first; the parts are found from the root of the repository.
    root = Path(__file__).resolve().parents[2]
    sys.path[:1] = [str(root), str(root / "benchmarks"), str(root / "tests")]
    sys.exit(main())
