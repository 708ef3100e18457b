"""How well a fleet is watched: alarms and life left on simulated fleets, and on a real wear path.

    python benchmarks/fleet.py alarms --seeds 101 102 103
    python benchmarks/fleet.py alarms --exponential --seeds 101 --actuators 15
    python benchmarks/fleet.py screw ../shared/data/xjtu_ball_screw/friction_torque.csv
    python benchmarks/fleet.py paths --seeds $(seq 300 399)
    python benchmarks/fleet.py predictions --seeds 104 --actuators 15 > predictions.json
    python benchmarks/fleet.py kill [postgresql://user@host/name]
    python benchmarks/fleet.py size
    python benchmarks/fleet.py errors
    python benchmarks/fleet.py known-law --every 30

Nothing in the package was tuned on these seeds.
"""

import argparse
import csv
import json
import resource
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from ematwin.estimation.constants import SMALLEST
from ematwin.fleet.fleet import Fleet
from ematwin.fleet.learning import learn
from ematwin.fleet.life import Life, paths
from ematwin.fleet.metrics import (
    cumulative_relative_accuracy,
    is_accurate,
    prognostic_horizon,
)
from ematwin.fleet.simulated import LIMITS, SimulatedFleet, worn
from ematwin.fleet.store import years
from ematwin.fleet.trend import Series, trend

END = datetime(2026, 1, 1, tzinfo=UTC)


def holds(one, left):
    """Whether the 80 % interval of a prediction holds the life that was left."""
    low, high = one.interval
    return low <= left <= high


def exponential_fit(series, limit, moment):
    """Life left by a least-squares fit of value = a exp(b t) + c, as often done; years."""
    from scipy.optimize import curve_fit

    n = series.time.size
    t = series.time - series.time[0]
    if n < 5:
        return np.inf

    def curve(t, a, b, c):
        return a * np.expm1(b * t) + c

    try:
        (a, b, c), _ = curve_fit(curve, t, series.value, p0=(0.05, 0.5, 0.0), maxfev=2000)
    except RuntimeError:
        return np.inf
    inside = (limit - c) / a + 1.0
    if inside <= 0.0 or b == 0.0:
        return np.inf
    end = np.log(inside) / b
    left = end - (moment - series.time[0])
    return max(left, 0.0) if np.isfinite(left) else np.inf


def worn_exponentially(random, days, severity, temperature):
    """Friction and gap grow at a rate that goes with them, from 2 % of the range a year."""
    time, found = np.arange(days) / 365.25, dict(worn(random, days, severity, temperature))
    for name in ("friction", "backlash"):
        first = severity * random.lognormal(np.log(0.02), 0.7)
        growth = random.lognormal(np.log(0.9), 0.3)
        found[name] = np.minimum(first * np.expm1(growth * time) / growth, 1.0)
    return found


def watched(seed, actuators, per_year, every, law=worn):
    """One fleet looked at every so many days: alarms, and predictions of what fails."""
    made = SimulatedFleet(actuators, 3.0, per_year, seed, END, law)
    truths = {serial: made.truth(serial) for serial in made.serial_numbers()}
    raised, predictions = [], {}
    with tempfile.TemporaryDirectory() as folder:
        store = Fleet(folder).store
        made.fill(store)
        with (store.folder / "fleet.toml").open("a") as file:
            file.write(f'[alarms]\nlook = "{every} days"\n')
        for day in range(180, made.days, every):
            now = made.start + timedelta(days=day)
            fleet = Fleet(folder, now=now)
            for event in fleet.update():
                if event["step"] != "none":
                    raised.append((day, event["serial_number"], event["magnitude"], event["step"]))
            moment = day / 365.25
            for unit in fleet:
                truth = truths[unit.serial_number]
                for name in unit.magnitudes:
                    end = truth.passes(name, day)
                    nearest = min((r for r, _ in truth.repairs if r > day), default=made.days)
                    if end is None or end > nearest or end == day:
                        continue
                    life = unit.life_left(name)
                    by_curve = exponential_fit(unit.series(name), LIMITS[name], life.moment)
                    key = (unit.serial_number, name, end)
                    predictions.setdefault(key, []).append(
                        (Life("x", life.draws, moment), by_curve)
                    )
        known = {
            unit.serial_number: [(row["time"] - made.start).days for row in unit.rows
                                 if row["grade"] != "none"] for unit in fleet
        }  # fmt: skip
    return made, truths, raised, predictions, known


def missed(truth, name, end, looks, known):
    """Why a failure had no alarm before its limit."""
    level = truth.level[name]
    begin = max((r for r, _ in truth.repairs if r <= end), default=0)
    began = begin + int(np.flatnonzero(level[begin:] >= SMALLEST)[0])
    last = max(day for day in looks if day <= end)
    seen = sum(began <= day <= last for day in known)
    if seen > 1:
        return "not recognised"
    return "began after the last look" if began > last else f"{seen} recordings since it began"


def judged(seed, *settings):
    """Counts of one fleet."""
    made, truths, raised, predictions, known = watched(seed, *settings)
    actuators, _, every, _ = settings
    looks = range(180, made.days, every)
    false = [
        one
        for one in raised
        if one[3] == "watch" and truths[one[1]].level[one[2]][one[0]] < SMALLEST
    ]
    known_a_year = [one for one in raised if one[3] == "act" and one[0] + 365 < made.days]
    soon = [(truths[who].passes(name, day) or made.days) <= day + 365
            for day, who, name, _ in known_a_year]  # fmt: skip
    held, every_one, ours, curves, horizons = 0, 0, [], [], []
    fails = {
        (serial, name, end)
        for serial, truth in truths.items()
        for name in LIMITS
        for begin in (180, *(r for r, _ in truth.repairs if r > 180))
        if (end := truth.passes(name, begin)) is not None
        and end > begin
        and not any(begin < r <= end for r, _ in truth.repairs)
    }
    before, why = {step: 0 for step in ("watch", "plan", "act")}, []
    for serial, name, end in fails:
        begin = max((r for r, _ in truths[serial].repairs if r <= end), default=0)
        steps = {
            s for d, who, what, s in raised if (who, what) == (serial, name) and begin <= d <= end
        }
        order = ["watch", "plan", "act"]
        for n, step in enumerate(order):
            before[step] += bool(steps & set(order[n:]))
        if not steps:
            why.append([serial, name, end, missed(truths[serial], name, end, looks, known[serial])])
    for (_, _, end), several in predictions.items():
        ends = end / 365.25
        made_ones = [one for one, _ in several]
        horizon = prognostic_horizon(made_ones, ends)
        horizons.append(horizon)
        for one in made_ones:
            if ends - one.moment <= horizon:
                every_one += 1
                held += holds(one, ends - one.moment)
        if len(made_ones) >= 3:
            ours.append(cumulative_relative_accuracy(made_ones, ends))
            flat = [Life("x", np.array([curve]), one.moment) for one, curve in several]
            curves.append(cumulative_relative_accuracy(flat, ends))
    whole = [
        holds(one, end / 365.25 - one.moment)
        for (_, _, end), several in predictions.items()
        for one, _ in several
    ]
    return {
        "seed": seed, "actuator_years": actuators * (made.days - 180) / 365.25,
        "false_alarms": len(false), "failures": len(fails),
        **{f"{step}_before": count for step, count in before.items()},
        "act": len(soon), "act_within_a_year_of_the_limit": sum(soon),
        "predictions": len(whole), "held_of_all": sum(whole),
        "from_horizon": every_one, "held_from_horizon": held,
        "median_horizon_years": float(np.median(horizons)) if horizons else 0.0,
        "cra": float(np.mean(ours)), "cra_exponential": float(np.mean(curves)),
        "missed": why, "false": false,
    }  # fmt: skip


def exported(seed, actuators, per_year, every):
    """Estimates and predictions of each failure, for other programs."""
    made, truths, _, predictions, _ = watched(seed, actuators, per_year, every)
    told = []
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(folder, now=END)
        made.fill(fleet.store)
        fleet.refresh()
        epoch = years(made.start)
        for (serial, name, end), several in predictions.items():
            ends = end / 365.25
            begin = max((r for r, _ in truths[serial].repairs if r <= end), default=0) / 365.25
            series = fleet[serial].series(name)
            time = series.time - epoch
            inside = (time >= begin) & (time <= ends)
            kept = [one for one, _ in several if one.moment > time[inside][0]]
            if len(kept) < 3:
                continue
            shares = np.linspace(0.005, 0.995, 100)
            few = [
                Life("x", np.quantile(one.draws, shares, method="inverted_cdf"), one.moment)
                for one in kept
            ]
            middle = time[inside][0] + 0.5 * (ends - time[inside][0])
            after = next((one for one in few if one.moment >= middle), few[-1])
            told.append(
                {
                    "end": ends, "limit": LIMITS[name], "time": time[inside].tolist(),
                    "value": series.value[inside].tolist(),
                    "moments": [one.moment for one in few],
                    "draws": [
                        [x if np.isfinite(x) else None for x in one.draws.tolist()] for one in few
                    ],
                    "alpha_lambda": is_accurate(after, ends),
                }
            )  # fmt: skip
    return told


def killed(address, times=20):
    """Two ``ematwin watch`` on one store, killed in turn: rows lost, and rows there twice.

    ``address`` of a PostgreSQL database; None for the folder.
    """
    import ematwin

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for n in range(3 * times):
            made = ematwin.simulate(actuator="sts3215", noise=0.01, seed=n)
            day = datetime(2025, 1, 1, tzinfo=UTC) + timedelta(days=n)
            inside = folder / "recordings" / f"S-{n % 3}"
            inside.mkdir(parents=True, exist_ok=True)
            ematwin.write(made, inside / f"{day:%Y-%m-%d}.parquet")
        (folder / "fleet").mkdir()
        if address is not None:
            (folder / "fleet" / "fleet.toml").write_text(f'store = "{address}"\n')
        store = Fleet(folder / "fleet").store
        command = [
            sys.executable, "-m", "ematwin", "watch", "recordings", "--fleet", "fleet",
            "--actuator", "sts3215",
        ]  # fmt: skip

        def start():
            return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)

        moments = np.random.default_rng(1)
        both, lost, seen, kills = [start(), start()], 0, set(), 0
        while kills < times and len(seen) < 3 * times:
            while True:  # until one of them has kept a recording more
                now = set(store.rows()["id"].to_pylist())
                if len(now) > len(seen) or all(one.poll() is not None for one in both):
                    break
                time.sleep(0.05)
            time.sleep(moments.uniform(0.0, 0.3))  # about as long as judging takes
            lost += len(seen - now)
            seen, n = now, kills % 2
            kills += both[n].poll() is None
            both[n].kill()
            both[n].wait()
            both[n] = start()
        codes = [one.wait() for one in both]
        content = store.rows()["content"].to_pylist()
        return {"kills": kills, "recordings": 3 * times, "rows": len(content), "lost": lost,
                "twice": len(content) - len(set(content)), "exit codes": codes}  # fmt: skip


def forecast(test, value, share):
    """Of the rest of one path of wear: which points lie within the 80 % interval, (m,) bools."""
    n = round(share * len(test))
    # no standard errors are stated: the scatter is learnt; a year stands for 100 tests
    one = Series(test / 100.0, value, np.zeros(len(test)), np.zeros((len(test), 2)))
    known = one.part(slice(n))
    wear = learn([known], float(value[0]), float(value[0]))
    to_come = paths(trend(known, wear), known.time[-1], "wiener", horizon=2.0, draws=2000)
    noise = np.sqrt(wear.variance(np.zeros(1))[0])
    level = to_come.level + noise * np.random.default_rng(1).standard_normal(to_come.level.shape)
    low, high = (
        np.interp(one.time[n:] - known.time[-1], to_come.ahead, np.quantile(level, q, axis=0))
        for q in (0.1, 0.9)
    )
    return (value[n:] >= low) & (value[n:] <= high)


def screw(path):
    """Forecasts of a real wear path, the friction torque of a ball screw, from parts of it."""
    with open(path, encoding="utf-8") as file:
        rows = [(float(r["test"]), float(r["friction_torque"])) for r in csv.DictReader(file)]
    return counted([np.array(rows).T])


def running_in(time, random):
    """Fast at first, then steady."""
    share, quick = random.uniform(0.2, 0.6), random.uniform(0.1, 0.4)
    return share * -np.expm1(-time / quick) + (1.0 - share) * time


def broken_line(time, random):
    """Another rate from some moment on."""
    at, factor = random.uniform(0.2, 0.8), random.lognormal(0.0, 0.7)
    return np.where(time < at, time, at + factor * (time - at))


LAWS = {  # share of the wear over time, both from 0 to 1
    "power": lambda time, random: time ** random.uniform(0.7, 2.2),
    "exponential": lambda time, random: np.expm1(2.5 * time) / np.expm1(2.5),
    "running in": running_in,
    "broken line": broken_line,
}


def made_up(seed, law="power"):
    """Tests and values of a path of 30 points by a law, with Wiener or gamma increments."""
    random = np.random.default_rng(seed)
    test = np.linspace(3.0, 100.0, 30)
    dt = np.diff(test, prepend=0.0) / 100.0
    value = 1.0 + random.uniform(0.1, 0.8) * LAWS[law](test / 100.0, random)
    spread, increments = random.uniform(0.0, 0.1), random.integers(3)
    if increments == 1:
        value = value + np.cumsum(random.normal(0.0, spread * np.sqrt(dt)))
    elif increments == 2:
        mean, variance = np.diff(value, prepend=1.0), spread**2 * dt + 1e-9
        value = 1.0 + np.cumsum(random.gamma(mean**2 / variance, variance / mean))
    return test, value + random.normal(0.0, random.uniform(0.003, 0.04), test.size)


def counted(several):
    """Points of paths within the intervals of forecasts from parts of each."""
    told = []
    for share in (1 / 3, 1 / 2, 2 / 3):
        every = [forecast(*one, share) for one in several]
        inside = np.concatenate(every)
        told.append({"share": share, "held": int(inside.sum()), "of": inside.size,
                     "whole_paths": sum(map(bool, map(np.all, every)))})  # fmt: skip
    return told


def size(actuators=60, per_year=1000 / 3):
    """Seconds and memory of a fleet of 60 actuators with 1,000 estimates each."""
    with tempfile.TemporaryDirectory() as folder:
        store = Fleet(folder).store
        SimulatedFleet(actuators, 3.0, per_year, 1, END).fill(store)
        begin, used = time.perf_counter(), time.process_time()
        fleet = Fleet(folder, now=END)
        page = Path(folder) / "fleet.html"
        fleet.report(page)
        return {
            "recordings": sum(len(one.rows) for one in fleet),
            "seconds": time.perf_counter() - begin,
            "cpu_seconds": time.process_time() - used,
            "peak_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
            "page_MB": page.stat().st_size / 1e6,
        }


def known_law(every, noise, seed=1, units=600):
    """The same counts of intervals for predictions that nothing can better.

    Levels are Wiener processes with rates from a normal distribution, read without error, and the
    predictions are their exact posteriors. What is missing to 80 % is due to the count: it takes
    failures within three years, and the prognostic horizon takes predictions near the truth.
    """
    random, days = np.random.default_rng(seed), round(3.0 * 365.25)
    mean, spread, told = 0.4, 0.15, np.zeros(4, dtype=int)  # rates a year; the limit is 1
    for _ in range(units):
        steps = np.sqrt(noise / 365.25) * random.standard_normal(days)
        level = np.cumsum(random.normal(mean, spread) / 365.25 + steps)
        beyond = np.flatnonzero(level >= 1.0)
        made = []
        for day in range(180, beyond[0] if beyond.size else 0, every):
            known = spread**-2 + (day + 1) / 365.25 / noise
            usual = (mean * spread**-2 + level[day] / noise) / known
            rate = random.normal(usual, known**-0.5, 1000)
            room = 1.0 - level[day]
            left = random.wald(room / np.maximum(rate, 1e-3), room**2 / noise)
            made.append(Life("x", left, day / 365.25))
        if made:
            end = beyond[0] / 365.25
            held = np.array([holds(one, end - one.moment) for one in made])
            near = [end - one.moment <= prognostic_horizon(made, end) for one in made]
            told += [held[near].sum(), sum(near), held.sum(), held.size]
    names = ("held_from_horizon", "from_horizon", "held_of_all", "predictions")
    return {"noise": noise, **dict(zip(names, told.tolist(), strict=True))}


def errors():
    """Standard errors of `identify` on a calibrated servo400, by fault."""
    import ematwin

    noise = ematwin.Noise(white=0.02, bits=12)
    healthy = [ematwin.simulate(None, actuator="servo400", noise=noise, seed=s) for s in range(3)]
    twin = ematwin.calibrate(healthy, "servo400")
    found = {}
    for faults in ({"friction": 0.2, "backlash": 0.1, "demagnetisation": 0.1}, {"short_a": 0.1}):
        record = ematwin.simulate(None, actuator="servo400", faults=faults, noise=noise, seed=9)
        standard = ematwin.identify(record, twin).estimate.standard_errors
        found |= {name: standard[name] for name in faults}
    return found


def main():
    """Read the command, and print its answer as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "what",
        choices=("alarms", "predictions", "screw", "paths", "size", "kill", "errors", "known-law"),
    )
    parser.add_argument("path", nargs="?")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101])
    parser.add_argument("--actuators", type=int, default=60)
    parser.add_argument("--per-year", type=float, default=50.0)
    parser.add_argument("--every", type=int, default=30)
    parser.add_argument("--exponential", action="store_true")
    given = parser.parse_args()
    settings = given.actuators, given.per_year, given.every
    law = worn_exponentially if given.exponential else worn
    if given.what == "alarms":
        for seed in given.seeds:
            print(json.dumps(judged(seed, *settings, law)), flush=True)
    elif given.what == "predictions":
        print(json.dumps([one for seed in given.seeds for one in exported(seed, *settings)]))
    elif given.what == "kill":
        print(json.dumps(killed(given.path)))
    elif given.what == "screw":
        print(json.dumps(screw(given.path)))
    elif given.what == "known-law":
        for noise in (0.004, 0.02, 0.06):
            print(json.dumps(known_law(given.every, noise)))
    elif given.what == "paths":
        for law in LAWS:
            counts = counted([made_up(seed, law) for seed in given.seeds])
            print(json.dumps({"law": law, "counts": counts}), flush=True)
    else:
        print(json.dumps({"size": size, "errors": errors}[given.what]()))


if __name__ == "__main__":
    main()
