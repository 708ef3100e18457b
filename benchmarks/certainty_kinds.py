"""The three methods on other kinds of actuator: docs/certainty.md.

    python benchmarks/certainty_kinds.py rm1605
    python benchmarks/certainty_kinds.py emps servo400

One recording of the twin with known faults, identified with parameters known exactly and by the
data sheet. Printed are seconds of processor time, the search included, intervals that miss the
truth, and doubts.
"""

import argparse
import time

import ematwin
from counted import holds
from ematwin.estimation.posterior import Posterior
from ematwin.estimation.uncertainty import Method
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.noise import Noise

FAULTS = {
    "rm1605": {"friction": 1.5, "backlash": 0.0003},
    "emps": {"friction": 2.5},
    "servo400": {"friction": 0.3, "backlash": 0.3},
}


def main() -> None:
    """Print a line for each actuator, knowledge and method."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("actuators", nargs="+", choices=FAULTS)
    parser.add_argument("--most", type=int, default=20_000, help="simulations of a posterior")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    methods: tuple[str | Method, ...] = ("laplace", "profile", Posterior(most=given.most))
    for name in given.actuators:
        actuator = load_actuator(name)
        model = model_of(actuator)
        truth = model.values_of(actuator, FAULTS[name])
        record = model.simulate(
            actuator, model.load_scenario(None), truth, fidelity=model.fidelities[-1],
            noise=None if model.noisy else Noise(white=0.02, bits=12), seed=given.seed,
        )  # fmt: skip
        ematwin.identify(record, actuator, exact=True, threads=1)  # compiles
        for exact in (True, False):
            for method in methods:
                started = time.process_time()
                found = ematwin.identify(
                    record, actuator, exact=exact, threads=1, uncertainty=method, seed=given.seed
                )
                spent = time.process_time() - started
                sure = found.uncertainty
                assert sure is not None
                ends = {one: sure.intervals[one] for one in sure.present}
                out = [one for one, interval in ends.items() if not holds(interval, truth[one])]
                print(
                    f"{name} {'exactly' if exact else 'data sheet'} {sure.method} {spent:.1f} s, "
                    f"{len(ends)} magnitudes, missed: {', '.join(out) or 'none'}. "
                    f"{' '.join(sure.doubts)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
