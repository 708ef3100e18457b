"""Calibrations with a data sheet of which one value is wrong: docs/lab/identification.md.

    python benchmarks/wrong_sheet.py emps
    python benchmarks/wrong_sheet.py servo48 --place motor.emf_constant

Three healthy recordings of the shipped actuator (for servo48 the default command twice and slow
reversals of 4 mrad) with 1 % white noise are calibrated with its sheet, of which one value is three
times, twice or half of the true one. Prints for each the value found over the true one, its
standard error, what the twin leaves of the recordings, and whether it is said as a finding; or the
refusal.
"""

import argparse

from ematwin import Scenario, calibrate, load_actuator, simulate
from ematwin.errors import EmatwinError
from ematwin.estimation.baseline import uncertain
from ematwin.models.registry import model_of
from ematwin.models.scenario import Sine

FACTORS = (3.0, 2.0, 0.5)
SLOW = Scenario(name="slow", duration=0.5, command=[Sine(amplitude=0.004, frequency=4.0)])
COMMANDS = {"servo48": (None, SLOW, None)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("actuator")
    parser.add_argument("--place", action="append")
    asked = parser.parse_args()
    truth = load_actuator(asked.actuator)
    places = asked.place or [one.name for one in uncertain(model_of(truth), truth)]
    commands = COMMANDS.get(asked.actuator, (None, None, None))
    recordings = [
        simulate(None, command, None, truth, noise=0.01, seed=n)
        for n, command in enumerate(commands, start=1)
    ]
    print("| parameter | sheet over true | found over true | standard error, % | left, % | |")
    print("|---|--:|--:|--:|--:|---|")
    for place in places:
        for factor in FACTORS:
            try:
                sheet = truth.changed({place: factor * truth.value(place)})
                found = calibrate(recordings, sheet)
            except EmatwinError as error:
                print(f"| {place} | {factor:g} | | | | {error} |", flush=True)
                continue
            one = next(p for p in found.parameters if p.place == place)
            if one.determined:
                said = "finding" if any(f"{place} at" in note for note in found.notes) else ""
            else:
                said = "not determined"
            print(
                f"| {place} | {factor:g} | {one.value / truth.value(place):.3f} "
                f"| {100.0 * one.standard_error / one.value:.2g} "
                f"| {100.0 * found.baseline.misfit:.2f} | {said} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
