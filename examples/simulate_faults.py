"""How strongly each fault of the paper's Table 1 shows in the current, in both models.

python examples/simulate_faults.py
python examples/simulate_faults.py --pages faults/    (one page a fault, to look at)
"""

import argparse
from pathlib import Path

import numpy as np

import ematwin
from ematwin.models.bldc.channels import shown_current
from ematwin.models.bldc.faults import PAPER_CASES, Faults
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.report.recordings import comparison_page

ACTUATOR = BldcActuator.load()


def current(model: str, faults: dict[str, float]) -> np.ndarray:
    """Equivalent current of the default scenario, A, behind a low-pass of 500 Hz."""
    return shown_current(ematwin.simulate(model, faults=faults), ACTUATOR)


def rms(signal: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(signal**2)))


def main() -> None:
    """Print the table; write the pages if they are wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pages", type=Path, help="write a page for each fault into this folder")
    pages = parser.parse_args().pages

    healthy = {model: current(model, {}) for model in ("reference", "monitor")}
    base = rms(healthy["reference"])
    print("change of the current by the fault, and what the models differ by, % of the healthy RMS")
    print(f"{'fault':<10} {'':<16} {'reference':>10} {'monitor':>10} {'models':>10}")
    for case, faults in PAPER_CASES.items():
        faulty = {model: current(model, faults) for model in healthy}
        changes = [rms(faulty[model] - healthy[model]) for model in healthy]
        gap = rms(faulty["reference"] - faulty["monitor"])
        text = ", ".join(f"{name}={value:g}" for name, value in faults.items())
        shares = " ".join(f"{100 * value / base:>10.2f}" for value in (*changes, gap))
        print(f"{case:<10} {text:<16} {shares}")
        if pages is not None:
            pages.mkdir(parents=True, exist_ok=True)
            record, reference = ematwin.simulate(faults=faults), ematwin.simulate()
            page = comparison_page(record, reference, Faults.of(faults).as_dict(), ACTUATOR)
            (pages / f"{case.replace(' ', '-').lower()}.html").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
