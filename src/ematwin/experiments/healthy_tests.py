"""Healthy tests from which the parameters that recordings leave open can be learnt.

They are chosen from the motions of `ematwin.experiments.candidates` one after another (greedy),
each with the smallest mean variance that then is left, in units of the tolerances: weighted
A-optimality (Atkinson, Donev and Tobias 2007, Optimum Experimental Designs, with SAS, sections 10.1
and 11.5). With C the covariance expected after a recording and P the inverse covariance of the
prior, its information is C^-1 - P. The information of several recordings adds up.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ematwin.errors import InputError, whole_number
from ematwin.estimation.constants import DETERMINED
from ematwin.experiments.candidates import candidates
from ematwin.experiments.experiment import UNANSWERED, Expected, Experiment
from ematwin.files import check_target
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.scenario import Scenario
from ematwin.numerics.linear_algebra import eigen, inverse
from ematwin.numerics.side_by_side import cores, side_by_side
from ematwin.recordings.noise import Noise
from ematwin.showing.results import drawn, frame, plain
from ematwin.showing.text import counted

TESTS = 3
_ADDS = 0.9  # ratio of standard errors: a further test has to lower one so far


def numbered(path: str | Path, count: int) -> list[Path]:
    """The names of so many tests: ``test.toml``, ``test-2.toml``, ..."""
    first = Path(path)
    return [first if n == 1 else first.with_stem(f"{first.stem}-{n}") for n in range(1, count + 1)]


@dataclass(frozen=True)
class HealthyTest:
    """A healthy test and the errors expected after it."""

    scenario: Scenario  # the command, with a description
    # expected standard error of the logarithm of each parameter after this test and those
    # before it, by place
    errors: dict[str, float]
    demands: dict[str, float]  # of the motion, by name, SI


@dataclass(frozen=True)
class HealthyTests:
    """Healthy tests, the most informative first."""

    actuator: ParameterSet  # on which they were simulated
    #: standard deviation of the logarithm of each parameter by the data sheet, by place
    tolerances: dict[str, float]
    known: dict[str, float]  #: the same as it is known now
    tests: tuple[HealthyTest, ...]
    #: expected standard errors after the given command was recorded as many times instead
    repeated: dict[str, float]
    given: Scenario  #: the given command
    limits: dict[str, float]  #: that the tests keep, by name, SI
    compared: int  #: commands that were compared
    refused: int  #: of these beyond the limits or without motion

    @property
    def scenarios(self) -> list[Scenario]:
        """Commands of the tests."""
        return [one.scenario for one in self.tests]

    @property
    def after(self) -> dict[str, float]:
        """Expected standard errors after all tests."""
        return self.tests[-1].errors if self.tests else self.known

    def open_after(self, errors: Mapping[str, float]) -> list[str]:
        """Places of the parameters that would not be determined with such standard errors."""
        least = {place: DETERMINED * tolerance for place, tolerance in self.tolerances.items()}
        return [place for place, error in errors.items() if not error < least[place]]

    def improves(self, test: int) -> list[str]:
        """Places whose error a test, counted from 0, lowers most."""
        before = self.tests[test - 1].errors if test else self.known
        ratios = {place: error / before[place] for place, error in self.tests[test].errors.items()}
        found = sorted((place for place in ratios if ratios[place] < _ADDS), key=ratios.__getitem__)
        return found[:3]  # parameters that a test is said to improve most

    @property
    def sentence(self) -> str:
        """How many parameters the tests determine, and which they add."""
        if not self.tests:
            return (
                "No test within the limits tells more of the parameters than is known. Raise a "
                "limit, or take a longer duration."
            )
        before, left = self.open_after(self.known), self.open_after(self.after)
        count = len(self.known)
        gained = [place for place in before if place not in left]
        told = (
            f"With {counted(len(self.tests), 'test')} {count - len(left)} of {count} parameters "
            f"are determined, {count - len(before)} now."
        )
        return f"{told} New: {', '.join(gained)}." if gained else told

    @property
    def open_sentence(self) -> str:
        """Parameters that stay open after all tests; "" if there are none."""
        left = self.open_after(self.after)
        if not left:
            return ""
        return (
            f"Not determined by any test within the limits: {', '.join(left)}. Higher limits, a "
            "longer test or further recorded channels may do it."
        )

    @property
    def next_sentence(self) -> str:
        """What to do with the tests."""
        return (
            "Record them on the healthy actuator, and give ematwin calibrate all healthy "
            "recordings, those so far included."
        )

    def to_frame(self) -> Any:
        """A pandas DataFrame with a row for each parameter, by place; needs pandas."""
        columns = {"tolerance": self.tolerances, "now": self.known}
        columns |= {f"after_{n}": one.errors for n, one in enumerate(self.tests, 1)}
        columns["repeated"] = self.repeated
        rows = (
            {"place": place, **{name: errors[place] for name, errors in columns.items()}}
            for place in self.known
        )
        return frame(rows, "place")

    to_dataframe = to_frame

    def plot(self, kind: str = "errors") -> Any:
        """A figure of plotly: "errors" (of each parameter) or "commands"."""
        return drawn(self, kind, {"errors": "plot_learnt_errors", "commands": "plot_healthy_tests"})

    def save(self, path: str | Path, *, replace: bool = True) -> list[Path]:
        """Write scenario files: the first test as ``path``, further ones numbered beside it.

        Raises
        ------
        InputError
            If a name has no suffix .toml, or a file is there and is not to be replaced.
        """
        paths = numbered(path, len(self.tests))
        for one in paths:
            check_target(one, (".toml",), replace=replace)
        for one, scenario in zip(paths, self.scenarios, strict=True):
            scenario.save(one)
        return paths

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        told = {"actuator": self.actuator.name, "given": self.given.name}
        return plain({
            **vars(self), **told, "sentence": self.sentence, "open": self.open_after(self.after)
        })  # fmt: skip


def healthy_tests(
    actuator: ParameterSet | str | Path | Any | None = None,
    *,
    scenario: Scenario | str | Path | None = None,
    duration: float | None = None,
    tests: int = TESTS,
    noise: Noise | None = None,
    sample_rate: float | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
    **limits: float,
) -> HealthyTests:
    """Tests of the healthy actuator that determine the parameters which recordings leave open.

    Parameters
    ----------
    actuator : a calibration or its file, whose posterior is the prior of the tests; or a parameter
        set of any kind, its name or file, whose tolerances are the prior
    scenario, duration, noise, sample_rate, threads, limits : as in `ematwin.design`; the duration
        is that of each test
    tests : how many are chosen at most; fewer where a further one lowers no standard error by a
        tenth
    seed : of the noise
    progress : called with the share done

    Raises
    ------
    InputError
        If an argument cannot be used, the kind's recordings differ by more than noise, nothing is
        uncertain, or no command within the limits moves the actuator enough.
    """
    whole_number(tests, "tests", 1)
    experiment = Experiment.of(actuator, noise=noise, sample_rate=sample_rate, seed=seed, threads=1)
    model, chosen = experiment.model, experiment.actuator
    if model.recordings_differ:
        raise InputError(
            f"Recordings of a healthy actuator of the kind {model.kind} differ by more than noise; "
            "no single test determines its parameters. Calibrate on several recordings of the "
            "motions that it makes in use."
        )
    limits = experiment.limits(limits)
    known = _Known(experiment)
    given = experiment.started(scenario, duration)
    # both models: they differ by a little, and a command keeps its own limits
    first = [experiment.demanded(given, fast=fast) for fast in (True, False)]
    within = {name: max(one.get(name, 0.0) for one in first) for name in first[-1]} | limits
    commands, done = [given, *candidates(model, given, within)], count(1)

    def usable_of(one: Scenario) -> _Usable | None:
        try:
            experiment.move(one, within)  # the fast model: it refuses most at little cost
            recording = experiment.move(one, within, fast=False)
            information = known.information(experiment.expected_healthy(recording))
            return _Usable(one, information, model.demanded(recording))
        except UNANSWERED:
            return None
        finally:
            if progress is not None:
                progress(next(done) / len(commands))

    found = side_by_side(usable_of, commands, threads or cores())
    usable = [one for one in found if one is not None]
    if not usable:
        told = ", ".join(f"{name} {value:g}" for name, value in within.items())
        raise InputError(
            f"No healthy test of {chosen.name} keeps the limits ({told}) and moves enough. Raise "
            "the limits, or leave some out."
        )
    best = _best(known, usable, tests)
    repeated = sum(one.information for one in usable if one.scenario is given)
    return HealthyTests(
        actuator=chosen,
        tolerances=known.tolerances,
        known=known.errors(known.precision),
        tests=best,
        repeated=known.errors(known.precision + max(1, len(best)) * repeated),
        given=given,
        limits=within,
        compared=len(commands),
        refused=len(commands) - len(usable),
    )


class _Usable(NamedTuple):
    scenario: Scenario
    information: np.ndarray  # (d, d)
    demands: dict[str, float]


class _Known:
    """The d parameters as they are known; (d, d) matrices of their logarithms."""

    def __init__(self, experiment: Experiment) -> None:
        prior = experiment.baseline.prior.of(one.name for one in experiment.parameters)
        # standard deviation of each by its tolerance, by place
        self.tolerances = {one.name: one.spread or 0.0 for one in experiment.parameters}
        self._root = np.linalg.cholesky(prior.covariance)
        self.precision = np.linalg.inv(prior.covariance)  # of the prior

    def information(self, expected: Expected) -> np.ndarray:
        """Information of a recording.

        Where the model error exceeds its evidence in some direction, a recording adds nothing.
        """
        mine = slice(len(self.tolerances))
        widths = expected.problem.chart.widths[mine]
        covariance = expected.covariance[mine, mine] * np.outer(widths, widths)
        values, vectors = eigen(self._root.T @ inverse(covariance) @ self._root)
        back = np.linalg.solve(self._root.T, vectors)
        return np.asarray(back * np.maximum(values - 1.0, 0.0) @ back.T)

    def errors(self, precision: np.ndarray) -> dict[str, float]:
        """Standard errors by place, of an inverse covariance."""
        found = np.sqrt(np.diag(inverse(precision))).tolist()
        return dict(zip(self.tolerances, found, strict=True))

    def left(self, precision: np.ndarray) -> float:
        """Mean variance, in units of the tolerances, of an inverse covariance."""
        spreads = np.array(list(self.tolerances.values()))
        return float(np.mean(np.diag(inverse(precision)) / spreads**2))


def _best(known: _Known, usable: Sequence[_Usable], most: int) -> tuple[HealthyTest, ...]:
    """The tests, one after another."""
    precision, rest = known.precision, list(usable)
    found: list[HealthyTest] = []
    while rest and len(found) < most:
        best = min(rest, key=lambda one: known.left(precision + one.information))
        rest = [one for one in rest if one is not best]
        before, after = (known.errors(one) for one in (precision, precision + best.information))
        if not any(after[place] < _ADDS * before[place] for place in after):
            break
        precision = precision + best.information
        found.append(HealthyTest(best.scenario, after, best.demands))
    return tuple(found)
