"""How often the damping of a Reference FMU, and a fault of it, are found within their intervals.

Put VanDerPol.fmu of Modelica's Reference FMUs beside this file, and run

    python examples/van_der_pol/recover.py 20

For each seed an oscillator is drawn with another damping than its file says, within the tolerance.
Two recordings of it with noise calibrate the file; a third, with a fault, is identified.
"""

import math
import sys
from pathlib import Path

import numpy as np

import ematwin

NOISE = 0.02  # standard deviation of both outputs


def noisy(record: ematwin.Recording, random: np.random.Generator) -> ematwin.Recording:
    """The recording with white noise on both outputs."""
    return record.changed(
        **{
            n: record.channels[n] + NOISE * random.standard_normal(len(record))
            for n in ("x0", "x1")
        }
    )


def recovered(file: Path, seed: int) -> tuple[bool, bool, bool]:
    """Whether the damping and the fault lie in their intervals, and whether the fault is named."""
    random = np.random.default_rng(seed)
    nominal = ematwin.load_actuator(file)
    damping = nominal.value("nominal.damping") * 1.4 ** (0.5 * random.standard_normal())
    wear = random.uniform(1.1, 2.0)
    unit = nominal.changed({"nominal.damping": damping})
    healthy = [noisy(ematwin.simulate(actuator=unit), random) for _ in range(2)]
    twin = ematwin.calibrate(healthy, file)
    found = twin.actuator.value("nominal.damping")
    error = math.sqrt(twin.baseline.prior.covariance[0, 0])  # of the logarithm
    record = noisy(ematwin.simulate(actuator=unit, faults={"wear": wear}), random)
    judged = ematwin.identify(record, twin)
    low, high = judged.intervals["wear"]
    return (
        abs(math.log(found / damping)) <= 1.96 * error,
        low <= wear <= high,
        judged.present == ("wear",),
    )


def main() -> None:
    """Count over seeds and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    file = Path(__file__).with_name("van-der-pol.toml")
    rows = np.array([recovered(file, seed) for seed in range(count)])
    for what, hits in zip(("damping", "fault", "named"), rows.sum(axis=0), strict=True):
        print(f"{what}: {hits} of {count}")


if __name__ == "__main__":
    main()
