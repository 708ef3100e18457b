"""Explorer: the response of the twin at the values of the sliders.

It knows no page and no widget. Everything is asked of the kind's comparison, as a search does.
`answered` checks every question of a page or widget. It can name unknowns, channels and shipped
scenarios that the explorer knows, and give numbers within their bounds. Nothing else gets through,
and no file can be named.
"""

import math
import threading
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, FiniteFloat, ValidationError

from ematwin.errors import EmatwinError, InputError
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find
from ematwin.models.reading import actuator_for, read
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Unknown
from ematwin.monitoring.identify import identify
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.report.style import BLUE, GREEN, GREY, ORANGE
from ematwin.showing.text import capital, said


class StoppedError(Exception):
    """Nobody waits for the answer any more."""


class Explorer:
    """A recording, its actuator's twin, and the unknowns that one may move.

    Parameters and errors are as of `ematwin.explore`. ``unknowns`` have a slider, by name: faults,
    then load and sensors where they matter. ``stopped`` is set to end a search that is under way.
    """

    def __init__(
        self, record: Recording | str | Path | None = None, actuator: Any = None,
        scenario: Scenario | str | Path | None = None,
    ) -> None:  # fmt: skip
        if record is not None and scenario is not None:
            raise InputError("A recording has its own command; leave the scenario out.")
        if actuator is None and record is not None:
            actuator = actuator_for(record)
        self._given = actuator
        self.actuator = load_actuator(actuator)
        self.model = model_of(self.actuator)
        self.recorded = record is not None
        self.stopped = threading.Event()
        self._searched = (0, 0)  # simulations of the search under way, and their maximum
        self.scenario = ""
        if record is None:
            self.choose(scenario)
        elif isinstance(record, Recording):
            self._take(record)
        else:
            self._take(read(record, actuator=self.actuator))

    def choose(self, scenario: Scenario | str | Path | None) -> None:
        """Ask the healthy twin for another scenario."""
        if self.recorded:
            raise InputError("A recording has its own command; explore without one instead.")
        asked = self.model.load_scenario(scenario)
        healthy = self.model.values_of(self.actuator, None)
        twin = self.model.fidelities[-1]  # that which candidates are simulated with
        self._take(self.model.simulate(self.actuator, asked, healthy, fidelity=twin))
        self.scenario = asked.name

    def _take(self, recording: Recording) -> None:
        self.recording = recording = self.model.averaged(recording)
        noted = recording.provenance.get("warnings", [])
        self.warnings = [*noted, *self.model.check(recording, self.actuator)]
        self._problem = Problem.of(recording, self.actuator)
        self._comparison = self._problem.comparisons[0]
        searched = set(self._problem.names)
        self.unknowns = {
            one.name: one
            for one in self.model.unknowns(self.actuator)
            if one.name in searched or (one.marginal and one.name not in self._comparison.ignores)
        }
        self._fitted: dict[str, float] = {}
        # a trace needs no more points than a screen has columns
        self._shown = slice(None, None, max(1, -(-len(recording) // 1500)))
        self._healthy = self._comparison.responses(self._batch({}, 1), 1)
        self._target = self._comparison.measured()
        if not self.recorded:  # its noise and its sensors are of no interest here
            recorded = self._target
            self._target = {name: rows[0] for name, rows in self._healthy.items()}
            missed = {name: recorded[name] - trace for name, trace in self._target.items()}
            self._comparison = self._comparison.with_missed(missed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the compared channels."""
        return tuple(self._target)

    # What is asked

    def setup(self) -> dict[str, Any]:
        """Contents of a page: sliders, channels, and all that does not change as they move."""
        captions = self._comparison.captions()
        rate = f"{len(self.recording)} samples at {self.recording.sample_rate:g} Hz"
        return {
            "title": f"{self.actuator.name}: {self.model.title}",
            "recorded": self.recorded,
            "source": f"{self.recording.name}, {rate}" if self.recorded else rate,
            "warnings": self.warnings,
            "scenario": self.scenario,
            "scenarios": [] if self.recorded else sorted(self.model.scenarios()),
            "sliders": [self._slider(one) for one in self.unknowns.values()],
            "channels": [
                {"name": name, "title": capital(captions[name][0]), "unit": self._shown_in(name)[0]}
                for name in self._target
            ],
            "inputs": self._inputs(),
            "time": _plain(self.recording.time[self._shown], exact=True),
            "colors": {"recorded": GREY, "twin": ORANGE, "healthy": BLUE, "truth": GREEN},
        }

    def traces(self, channel: str) -> dict[str, Any]:
        """Traces of a channel that no slider changes: the recording and the healthy twin."""
        factor = self._shown_in(channel)[1]
        return {
            "recorded": _plain(factor * self._target[channel][self._shown]),
            "healthy": _plain(factor * self._healthy[channel][0][self._shown]),
            "healthy_misfit": self._misfits(self._batch({}, 1), 1)[0],
        }

    def answer(self, values: Mapping[str, float], channel: str, fitted: bool) -> dict[str, Any]:
        """The twin's answer in a channel where the sliders stand; missing values are healthy.

        ``fitted`` takes parameters, load and sensors from the last `verdict`.
        """
        one = self._batch(values, 1, fitted)
        answer = self._comparison.responses(one, 1)[channel][0]
        factor = self._shown_in(channel)[1]
        return {
            "twin": _plain(factor * answer[self._shown]),
            "residual": _plain(factor * (self._target[channel] - answer)[self._shown]),
            "misfit": self._misfits(one, 1)[0],
            "said": {name: self._said(name, values) for name in self.unknowns},
        }

    def profile(self, values: Mapping[str, float], along: str, fitted: bool) -> dict[str, Any]:
        """The misfit over the range of one unknown, the others where the sliders stand."""
        one = self.unknowns[along]
        space = np.geomspace if one.logarithmic else np.linspace
        count = 64  # full lanes
        grid = space(one.lower, one.upper, count)
        batch = self._batch(values, count, fitted) | {along: grid}
        rows = [one.physical_value(self.actuator, float(x)) for x in grid]
        x, unit = np.array([row.value for row in rows]), rows[0].unit
        if not (np.diff(x) > 0.0).all():
            x, unit = grid, one.unit  # no axis: the physical value turns back
        unit, factor = preferred(unit)
        return {
            "along": along,
            "position": _plain(grid, exact=True),
            "x": _plain(factor * x, exact=True),
            "unit": _spaced(unit),
            "misfit": self._misfits(batch, count),
        }

    def fit(self, values: Mapping[str, float], fitted: bool) -> dict[str, Any]:
        """Descend from where the sliders stand; load and sensors stay unless they are searched.

        Where the kind has a smoother misfit, that is descended first: its minima are wider.
        """
        problem = self._problem
        every = {**(self._fitted if fitted else {}), **values}
        held = {n: x for n, x in every.items() if n not in problem.names}
        sharp = Problem(
            [self._comparison], problem.unknowns, held={**problem.held, **held},
            prior=problem.prior,
        )  # fmt: skip
        starts = np.array([[values.get(one.name, one.healthy) for one in problem.unknowns]])
        evaluations = 0
        if (smooth := sharp.smoothed()) is not sharp:
            first = find(smooth, LocalDescent(starts=starts), progress=self._still_wanted)
            starts = np.vstack([starts, first.point])
            evaluations = first.evaluations
        found = find(sharp, LocalDescent(starts=starts), progress=self._still_wanted)
        self._searched = (0, 0)
        point = np.clip(found.point, problem.lower, problem.upper)
        return {
            "values": dict(zip(problem.names, point.tolist(), strict=True)),
            "evaluations": evaluations + found.evaluations,
        }

    def verdict(self) -> dict[str, Any]:
        """A whole identification: its verdict, and values with intervals."""
        if not self.recorded:
            raise InputError("There is no recording to judge; explore one.")
        try:
            found = identify(self.recording, self._given, progress=self._still_wanted)
        finally:
            self._searched = (0, 0)
        known = {**found.fitted, **found.values}
        self._fitted = {n: x for n, x in known.items() if n not in self.unknowns}
        sliders = {n: one for n, one in self.unknowns.items() if n in known}
        return {
            "grade": found.verdict.grade, "sentence": found.verdict.sentence,
            "warnings": found.warnings, "present": list(found.present),
            "values": {n: min(max(known[n], o.lower), o.upper) for n, o in sliders.items()},
            "intervals": {n: list(e) for n, e in found.intervals.items() if n in self.unknowns},
            "fitted": bool(self._fitted), "evaluations": found.evaluations,
            "seconds": found.seconds,
        }  # fmt: skip

    def progress(self) -> dict[str, Any]:
        """Simulations of the `verdict` under way, and their maximum; may be asked meanwhile."""
        return dict(zip(("evaluations", "most"), self._searched, strict=True))

    # How it is answered

    def _still_wanted(self, evaluations: int, cost: float, budget: int) -> None:
        self._searched = (evaluations, budget)
        if self.stopped.is_set():
            raise StoppedError

    def _batch(
        self, values: Mapping[str, float], count: int, fitted: bool = False
    ) -> dict[str, np.ndarray]:
        healthy = {name: one.healthy for name, one in self.unknowns.items()}
        every = {**healthy, **(self._fitted if fitted else {}), **values}
        return {name: np.full(count, value) for name, value in every.items()}

    def _misfits(self, batch: Mapping[str, np.ndarray], count: int) -> list[float | None]:
        """Relative misfits; None where the twin diverged."""
        costs = self._comparison.costs(batch, count)
        misfits = [self._problem.relative_misfit(float(cost)) for cost in costs]
        return [x if math.isfinite(x) else None for x in misfits]

    def _said(self, name: str, values: Mapping[str, float]) -> str:
        """A value in its physical unit: "0.045 N m"."""
        one = self.unknowns[name]
        row = one.physical_value(self.actuator, values.get(name, one.healthy))
        return said(row.value, row.unit)

    def _shown_in(self, channel: str) -> tuple[str, float]:
        """The unit in which a compared channel is shown, and the factor to it."""
        unit, factor = preferred(self._comparison.captions()[channel][1])
        return _spaced(unit), factor

    def _slider(self, one: Unknown) -> dict[str, Any]:
        source = self.recording.provenance
        known = self.recorded and source.get("source") == "simulated"
        truth = (source.get("faults") or {}).get(one.name) if known else None
        return {
            "name": one.name, "title": one.name.replace("_", " ").capitalize(),
            "meaning": capital(one.meaning), "fault": one.role == "fault", "lower": one.lower,
            "upper": one.upper, "healthy": one.healthy, "logarithmic": one.logarithmic,
            "ends": [self._said(one.name, {one.name: x}) for x in (one.lower, one.upper)],
            "truth": truth if truth is not None and one.lower <= truth <= one.upper else None,
        }  # fmt: skip

    def _inputs(self) -> list[dict[str, Any]]:
        """Command and load over time; a load of zero is left out."""
        found = []
        for name in self.model.inputs:
            trace = self.recording.channels.get(name)
            if trace is None or (name == self.model.load and not trace.any()):
                continue
            one = self.model.channel(name)
            unit, factor = preferred(one.unit)
            shown = _plain(factor * trace[self._shown])
            found.append({"title": capital(one.meaning), "unit": _spaced(unit), "values": shown})
        return found


def _spaced(text: str) -> str:
    return text.replace("*", " ")


def _plain(values: np.ndarray, exact: bool = False) -> list[float | None]:
    """Numbers for JSON, short unless they must be exact; None if not finite."""
    finite = np.isfinite(values)
    if not exact and finite.any():
        largest = float(np.abs(values[finite]).max())
        if largest > 0.0:  # five digits of it
            values = np.round(values, 5 - math.ceil(math.log10(largest)))
    return [x if ok else None for x, ok in zip(values.tolist(), finite.tolist(), strict=True)]


class _Question(BaseModel):
    model_config = ConfigDict(strict=True)

    ask: str
    values: dict[str, FiniteFloat] = {}
    channel: str = ""
    along: str = ""
    name: str = ""  # of a scenario
    fitted: bool = False


def answered(explorer: Explorer, question: Any) -> dict[str, Any]:
    """The answer to a question, or ``{"error": sentence}``; safe to write as JSON.

    One at a time, but for those that do not `wait`: an explorer keeps no lock.
    """
    try:
        asked = _Question.model_validate(question)
        return _REPLIES[_one_of(_REPLIES, asked.ask, "ask")](explorer, asked)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part)[:40] for part in first["loc"]) or "The question"
        return {"error": f"{place}: {first['msg']}."}
    except EmatwinError as error:
        return {"error": str(error)}


def waits(question: Any) -> bool:
    """Whether a question waits for the answer to the one before; progress is told meanwhile."""
    return not (isinstance(question, Mapping) and question.get("ask") == "progress")


def _scenario(explorer: Explorer, question: _Question) -> dict[str, Any]:
    explorer.choose(_one_of(explorer.model.scenarios(), question.name, "name"))
    return explorer.setup()


def _channel(explorer: Explorer, question: _Question) -> str:
    return _one_of(explorer.channels, question.channel, "channel")


_REPLIES: Mapping[str, Callable[[Explorer, _Question], dict[str, Any]]] = {
    "setup": lambda e, _: e.setup(),
    "traces": lambda e, q: e.traces(_channel(e, q)),
    "answer": lambda e, q: e.answer(_values(e, q), _channel(e, q), q.fitted),
    "profile": lambda e, q: e.profile(
        _values(e, q), _one_of(e.unknowns, q.along, "along"), q.fitted
    ),
    "fit": lambda e, q: e.fit(_values(e, q), q.fitted),
    "verdict": lambda e, _: e.verdict(),
    "progress": lambda e, _: e.progress(),
    "scenario": _scenario,
}


def _values(explorer: Explorer, question: _Question) -> dict[str, float]:
    """Values by name, each of an unknown and within its bounds."""
    return {
        _one_of(explorer.unknowns, name, "A slider"): explorer.unknowns[name].check(value)
        for name, value in question.values.items()
    }


def _one_of(known: Collection[str], given: str, what: str) -> str:
    if given not in known:
        raise InputError(f"{what} must be one of {', '.join(known)}.")
    return given
