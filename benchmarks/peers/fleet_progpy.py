"""Life left by ProgPy's particle filter, and ProgPy's metrics, on the predictions of a fleet.

    python benchmarks/fleet.py predictions --seeds 104 --actuators 15 > predictions.json
    pip install progpy
    python benchmarks/peers/fleet_progpy.py predictions.json

ProgPy (NASA, NOSA) is no dependency: give it an environment of its own. Its model here is the
usual one, a level that grows with a rate; both come as particles. How much the rate wanders is for
the user to say: each of `RATE_NOISES` is tried. It gets the same estimates, since the last repair.
"""

import json
import sys
import warnings

import numpy as np
from progpy import PrognosticsModel
from progpy.predictors import ToEPredictionProfile
from progpy.state_estimators import ParticleFilter
from progpy.uncertain_data import UnweightedSamples

PARTICLES = 500
RATE_NOISES = (1e-6, 1e-5, 1e-4)  # standard deviations per step and day


class Wear(PrognosticsModel):
    """A level with a constant rate; time in days."""

    inputs = []  # noqa: RUF012 (as ProgPy's own models)
    states = ["level", "rate"]  # noqa: RUF012
    outputs = ["level"]  # noqa: RUF012
    events = ["worn"]  # noqa: RUF012
    is_vectorized = True
    default_parameters = {  # noqa: RUF012
        "x0": {"level": 0.0, "rate": 0.0}, "limit": 1.0,
        "process_noise": {"level": 1e-4, "rate": 1e-6},
        "measurement_noise": {"level": 0.006},
    }  # fmt: skip

    def dx(self, x, u):
        """The level moves with the rate."""
        return self.StateContainer({"level": x["rate"], "rate": 0.0 * x["rate"]})

    def output(self, x):
        """The level is estimated."""
        return self.OutputContainer({"level": x["level"]})

    def event_state(self, x):
        """One when new, zero at the limit."""
        return {"worn": 1.0 - x["level"] / self.parameters["limit"]}


def filtered(one, rate_noise=RATE_NOISES[0]):
    """Draws of the life left, years, at each moment of a prediction."""
    np.random.seed(1)  # noqa: NPY002 (ProgPy draws from it)
    model = Wear(limit=one["limit"], process_noise={"level": 1e-4, "rate": rate_noise})
    random = np.random.default_rng(1)
    start = {
        "level": np.abs(random.normal(0.0, 0.01, PARTICLES)),
        "rate": np.abs(random.normal(0.1, 0.1, PARTICLES)) / 365.25,
    }
    begin = one["time"][0]
    particles = UnweightedSamples(
        [{"level": a, "rate": b} for a, b in zip(start["level"], start["rate"], strict=True)]
    )
    tracked = ParticleFilter(
        model, particles, num_particles=PARTICLES, t0=-1.0,
        measurement_noise=model.parameters["measurement_noise"],
    )  # fmt: skip
    told, n = [], 0
    days = [365.25 * (t - begin) for t in one["time"]]
    for moment in one["moments"]:
        while n < len(days) and one["time"][n] <= moment:
            if n == 0 or days[n] > days[n - 1]:
                tracked.estimate(days[n], {}, {"level": one["value"][n]}, dt=30.0)
            n += 1
        level = np.array([p["level"] for p in tracked.x.data], dtype=float).ravel()
        rate = np.array([p["rate"] for p in tracked.x.data], dtype=float).ravel()
        with np.errstate(divide="ignore"):
            left = np.where(rate > 0.0, (one["limit"] - level) / rate / 365.25, np.inf)
        told.append(np.maximum(left, 0.0))
    return told


def accuracy(predictions, one):
    """Cumulative relative accuracy of medians, as `ematwin.fleet.metrics` has it."""
    found = []
    for moment, draws in zip(one["moments"], predictions, strict=True):
        left = one["end"] - moment
        error = abs(np.quantile(draws, 0.5, method="inverted_cdf") - left) / left
        found.append(max(0.0, 1.0 - error) if np.isfinite(error) else 0.0)
    return float(np.mean(found))


def held(predictions, one):
    """Which 80 % intervals hold the truth, (N,) bools."""
    return np.array([
        np.quantile(d, 0.1, method="inverted_cdf") <= one["end"] - m
        <= np.quantile(d, 0.9, method="inverted_cdf")
        for m, d in zip(one["moments"], predictions, strict=True)
    ])  # fmt: skip


def visible(one):
    """At which moments the last three estimates show a fault, (N,) bools."""
    time, value = np.array(one["time"]), np.array(one["value"])
    return np.array([np.median(value[time <= m][-3:]) >= 0.05 for m in one["moments"]])


def by_progpy(predictions, one):
    """Prognostic horizon and alpha-lambda at half of the life, by ProgPy's own functions."""
    profile = ToEPredictionProfile()
    for moment, draws in zip(one["moments"], predictions, strict=True):
        ends = [{"worn": min(moment + d, 1e6)} for d in draws]
        profile.add_prediction(moment, UnweightedSamples(ends))
    truth, reach = {"worn": one["end"]}, 0.2 * (one["end"] - one["time"][0])

    def good(left, actual):
        bounds = {"worn": [actual["worn"] - reach, actual["worn"] + reach]}
        return {"worn": left.percentage_in_bounds(bounds)["worn"] >= 0.5}

    middle = one["time"][0] + 0.5 * (one["end"] - one["time"][0])
    met = profile.alpha_lambda(truth, middle, 0.2, 0.5)
    return {
        "horizon": profile.prognostic_horizon(good, truth)["worn"],
        "alpha_lambda": None if met is None else bool(met["worn"]),
    }


def main():
    """Compare on each failure of a file."""
    warnings.simplefilter("ignore")
    with open(sys.argv[1], encoding="utf-8") as file:
        several = json.load(file)
    ours, same, count, ours_held = [], [], np.zeros(2, int), np.zeros(2, int)
    theirs = {noise: [] for noise in RATE_NOISES}
    theirs_held = {noise: np.zeros(2, int) for noise in RATE_NOISES}
    for one in several:
        draws = [np.array([np.inf if x is None else x for x in d]) for d in one["draws"]]
        ours.append(accuracy(draws, one))
        shown = np.array([np.ones(len(draws), dtype=bool), visible(one)])  # all, and these
        count += shown.sum(axis=1)
        ours_held += (shown & held(draws, one)).sum(axis=1)
        for noise in RATE_NOISES:
            other = filtered(one, noise)
            theirs[noise].append(accuracy(other, one))
            theirs_held[noise] += (shown & held(other, one)).sum(axis=1)
        found = by_progpy(draws, one)
        same.append(found["alpha_lambda"] in (None, one["alpha_lambda"]))
    print(
        json.dumps(
            {
                "failures": len(several), "predictions": count.tolist(), "cra": np.mean(ours),
                "held": ours_held.tolist(), "alpha_lambda_agree": sum(same),
                "cra_progpy": {noise: np.mean(several) for noise, several in theirs.items()},
                "held_progpy": {noise: n.tolist() for noise, n in theirs_held.items()},
            }
        )
    )  # fmt: skip


if __name__ == "__main__":
    main()
