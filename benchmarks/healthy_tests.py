"""Expected errors of healthy tests against errors of calibrations: docs/lab/design.md.

    python benchmarks/healthy_tests.py --actuators 12

`ematwin.healthy_tests` proposes three tests for servo48 by its data sheet, at a position gain of 60
1/s and a speed gain of 0.004 N m s/rad. Then actuators are drawn whose parameters lie within the
tolerances. Each answers the tests by the reference model, with 1 % white noise, sensors and load
cell off by 1 % (one standard deviation), and is calibrated with the data sheet. Prints, for the
tests and for as many recordings of the default command, of each parameter that the tests determine:
the promised standard error, the error over the promise (root mean square), and the share of errors
within 1.96 of it; calibrations that are refused or find a form that is not there are named.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

from ematwin import Noise, Scenario, healthy_tests, load_actuator, simulate
from ematwin.errors import EmatwinError
from ematwin.estimation.learn import learn
from ematwin.experiments.experiment import Experiment
from ematwin.models.registry import model_of
from ematwin.recordings.recording import Recording

GAINS = {"controller.position_gain": 60.0, "controller.speed_gain": 0.004}
SENSOR = 0.01  # standard deviation of the gain of current sensors and load cell
NOISE = Noise(white=0.01)


def recorded(scenario: Scenario, actuator: object, seed: int) -> Recording:
    """A healthy recording by sensors that are off."""
    found = simulate("reference", scenario, None, actuator, noise=NOISE, seed=seed)
    rng = np.random.default_rng(seed)
    current, load = 1.0 + SENSOR * rng.standard_normal(2)
    gains = {name: current for name in ("current_a", "current_b", "current_c")} | {"load": load}
    channels = {name: gain * found.channels[name] for name, gain in gains.items()}
    return found.changed(**channels)


def errors_of(seed: int, sets: list[list[Scenario]]) -> list[dict[str, float] | None]:
    """Errors of logarithms by place, for each set of tests; None where it is refused."""
    sheet = load_actuator("servo48").changed(GAINS)
    experiment = Experiment.of(sheet)
    actuator = experiment.drawn_actuator(np.random.default_rng(seed))
    model = model_of(sheet)
    found: list[dict[str, float] | None] = []
    for commands in sets:
        healthy = [recorded(one, actuator, 100 * seed + n) for n, one in enumerate(commands)]
        try:
            known = learn(model, sheet, [model.compare(one, sheet) for one in healthy])
        except EmatwinError as error:
            print(f"actuator {seed}: {error}")
            found.append(None)
            continue
        if known.baseline.forms:
            print(f"actuator {seed}: forms that are not there: {known.baseline.forms}")
        found.append({
            p.place: float(np.log(p.value / actuator.value(p.place)))
            for p in known.parameters
            if actuator.parameter(p.place) is not None
        })  # fmt: skip
    print(f"actuator {seed} is done", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--actuators", type=int, default=12)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    sheet = load_actuator("servo48").changed(GAINS)
    proposed = healthy_tests(sheet, noise=NOISE)
    for one in proposed.scenarios:
        print(one.description)
    sets = [proposed.scenarios, [proposed.given] * len(proposed.tests)]
    seeds = range(asked.first, asked.first + asked.actuators)
    every = Parallel(asked.jobs)(delayed(errors_of)(seed, sets) for seed in seeds)
    print("\n| parameter | promised, % | error/promise | within 1.96, % |"
          " promised, default | error/promise | within |")  # fmt: skip
    print("|---|--:|--:|--:|--:|--:|--:|")
    told = [p for p in proposed.known if p not in proposed.open_after(proposed.after)]
    total: list[list[float]] = [[], []]
    for place in told:
        cells = []
        for n, promised in enumerate((proposed.after[place], proposed.repeated[place])):
            ratios = [one[n][place] / promised for one in every if one[n] is not None]
            total[n] += ratios
            cells += [f"{100.0 * promised:.2g}", *summed(ratios)]
        print(f"| {place} | {' | '.join(cells)} |")
    print(f"| all | | {' | '.join(summed(total[0]))} | | {' | '.join(summed(total[1]))} |")
    refused = [sum(one[n] is None for one in every) for n in range(2)]
    print(f"\nrefused of {asked.actuators}: {refused[0]} and {refused[1]}")


def summed(ratios: list[float]) -> tuple[str, str]:
    """Root mean square, and share within 1.96, %."""
    values = np.array(ratios)
    return f"{np.sqrt(np.mean(values**2)):.2f}", f"{100.0 * np.mean(np.abs(values) < 1.96):.0f}"


if __name__ == "__main__":
    main()
