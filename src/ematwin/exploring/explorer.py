"""Explorer: the response of the twin at the values of the sliders.

It knows no page and no widget. Everything is asked of the kind's comparison, as a search does.
`answered` lets a page or widget ask what is in `QUESTIONS`. Questions can name unknowns, channels
and shipped scenarios that the explorer knows, and give numbers within their bounds. Nothing else
gets through, and no file can be named.
"""

import threading
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, FiniteFloat, ValidationError, validate_call

from ematwin.errors import EmatwinError, InputError
from ematwin.estimation.local import LocalDescent
from ematwin.estimation.problem import Problem
from ematwin.estimation.search import find
from ematwin.models.reading import actuator_for, read
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.scenario import Scenario
from ematwin.models.simulating import simulate
from ematwin.models.unknown import Unknown
from ematwin.monitoring.identify import identify
from ematwin.quantities import preferred
from ematwin.recordings.recording import Recording
from ematwin.report.style import BLUE, GREEN, GREY, ORANGE
from ematwin.showing.results import plain
from ematwin.showing.text import capital, in_unit, said

QUESTIONS = ("setup", "answer", "profile", "fit", "verdict", "progress", "scenario")
_question = validate_call(config=ConfigDict(strict=True))  # refuses arguments of other types


class StoppedError(Exception):
    """Nobody waits for the answer any more."""


class Explorer:
    """A recording, its actuator's twin, and the unknowns that one may move.

    Parameters and errors are as of `ematwin.explore`. ``unknowns`` have a slider, by name: faults,
    then load and sensors where they matter. ``stopped`` is set to end a search that is under way.

    In questions, ``values`` are where the sliders stand, healthy if missing; ``fitted`` takes
    parameters, load and sensors without a slider from the last `verdict`.
    """

    def __init__(
        self, record: Recording | str | Path | None = None, actuator: Any = None,
        scenario: Scenario | str | Path | None = None,
    ) -> None:  # fmt: skip
        if record is not None and scenario is not None:
            raise InputError("A recording has its own command; leave the scenario out.")
        if record is not None and actuator is None:
            actuator = actuator_for(record)
        self._given, self.actuator = actuator, load_actuator(actuator)
        self.model = model_of(self.actuator)
        self.recorded = record is not None
        self.stopped = threading.Event()
        self._searched = (0, 0)  # simulations of the search under way, and their maximum
        if record is None:
            record = self._simulated(scenario)
        elif not isinstance(record, Recording):
            record = read(record, actuator=self.actuator)
        self._take(record)

    def _simulated(self, scenario: Scenario | str | Path | None) -> Recording:
        twin = self.model.fidelities[-1]  # that which candidates are simulated with
        return simulate(twin, scenario, actuator=self.actuator)

    def _take(self, recording: Recording) -> None:
        self.recording = recording = self.model.averaged(recording)
        self._doubts = self.model.check(recording, self.actuator)
        self._problem = problem = Problem.of(recording, self.actuator)
        self._comparison = comparison = problem.comparisons[0]
        self.unknowns = {
            one.name: one
            for one in self.model.unknowns(self.actuator)
            if one.name in problem.names or (one.marginal and one.name not in comparison.ignores)
        }
        self._fitted: dict[str, float] = {}
        # a trace needs no more points than a screen has columns
        self._kept = slice(None, None, max(1, -(-len(recording) // 1500)))
        self._target, self._healthy = comparison.measured(), self._response({})
        if not self.recorded:  # its noise and its sensors are of no interest here
            missed = {name: self._target[name] - trace for name, trace in self._healthy.items()}
            self._target, self._comparison = self._healthy, comparison.with_missed(missed)

    # Questions

    @_question
    def setup(self) -> dict[str, Any]:
        """Contents of a page: sliders, and all that does not change as they move."""
        recording, source = self.recording, self.recording.provenance
        rate = f"{len(recording)} samples at {recording.sample_rate:g} Hz"
        channels, inputs = [], []
        for name, caption in self._comparison.captions().items():
            recorded, healthy = self._target[name], self._healthy[name]
            traced = self._traced(*caption, recorded=recorded, healthy=healthy)
            channels.append({"name": name, **traced})
        for one in (self.model.channel(name) for name in self.model.inputs):
            trace = recording.channels.get(one.name)
            if trace is not None and (one.name != self.model.load or trace.any()):
                inputs.append(self._traced(one.meaning, one.unit, values=trace))
        return {
            "title": f"{self.actuator.name}: {self.model.title}",
            "recorded": self.recorded,
            "source": f"{recording.name}, {rate}" if self.recorded else rate,
            "warnings": [*source.get("warnings", []), *self._doubts],
            "scenario": source.get("scenario", ""),
            "scenarios": [] if self.recorded else sorted(self.model.scenarios()),
            "sliders": [self._slider(one) for one in self.unknowns.values()],
            "channels": channels,
            "inputs": inputs,
            "time": recording.time[self._kept],
            "healthy_misfit": self._misfits({})[0],
            "colors": {"recorded": GREY, "twin": ORANGE, "healthy": BLUE, "truth": GREEN},
        }

    @_question
    def answer(
        self, values: dict[str, FiniteFloat], channel: str, fitted: bool = False
    ) -> dict[str, Any]:
        """The twin's answer in a channel where the sliders stand."""
        at, captions = self._at(values, fitted), self._comparison.captions()
        caption = captions[_one_of(captions, channel, "channel")]
        twin = self._response(at)[channel]
        return {
            **self._traced(*caption, twin=twin, residual=self._target[channel] - twin),
            "misfit": self._misfits(at)[0],
            "said": {name: self._said(one, at) for name, one in self.unknowns.items()},
        }

    @_question
    def profile(
        self, values: dict[str, FiniteFloat], along: str, fitted: bool = False
    ) -> dict[str, Any]:
        """The misfit over the range of one unknown, the others where the sliders stand."""
        at, one = self._at(values, fitted), self.unknowns[_one_of(self.unknowns, along, "along")]
        space = np.geomspace if one.logarithmic else np.linspace
        grid = space(one.lower, one.upper, 64)  # full lanes
        rows = [one.physical_value(self.actuator, float(x)) for x in grid]
        x, unit = np.array([row.value for row in rows]), rows[0].unit
        if not (np.diff(x) > 0.0).all():
            x, unit = grid, one.unit  # no axis: the physical value turns back
        unit, factor = preferred(unit)
        return {
            "along": along, "position": grid, "x": factor * x, "unit": in_unit("", unit).strip(),
            "misfit": self._misfits({**at, along: grid}, grid.size),
        }  # fmt: skip

    @_question
    def fit(self, values: dict[str, FiniteFloat], fitted: bool = False) -> dict[str, Any]:
        """Descend from where the sliders stand; load and sensors stay unless they are searched.

        Where the kind has a smoother misfit, that is descended first: its minima are wider.
        """
        at, problem = self._at(values, fitted), self._problem
        held = {**problem.held, **{n: x for n, x in at.items() if n not in problem.names}}
        sharp = Problem([self._comparison], problem.unknowns, held=held, prior=problem.prior)
        starts, spent = np.array([[at.get(one.name, one.healthy) for one in sharp.unknowns]]), 0
        for stage in dict.fromkeys((sharp.smoothed(), sharp)):
            found = find(stage, LocalDescent(starts=starts), progress=self._still_wanted)
            starts, spent = np.vstack([starts, found.point]), spent + found.evaluations
        self._searched = (0, 0)
        point = np.clip(found.point, sharp.lower, sharp.upper).tolist()
        return {"values": dict(zip(sharp.names, point, strict=True)), "evaluations": spent}

    @_question
    def verdict(self) -> dict[str, Any]:
        """A whole identification as `Identification.as_dict`, with values for the sliders."""
        if not self.recorded:
            raise InputError("There is no recording to judge; explore one.")
        try:
            found = identify(self.recording, self._given, progress=self._still_wanted)
        finally:
            self._searched = (0, 0)
        known = {**found.fitted, **found.values}
        self._fitted = {name: x for name, x in known.items() if name not in self.unknowns}
        sliders = {name: one for name, one in self.unknowns.items() if name in known}
        values = {n: min(max(known[n], one.lower), one.upper) for n, one in sliders.items()}
        return {**found.as_dict(), "values": values, "fitted": bool(self._fitted)}

    @_question
    def progress(self) -> dict[str, Any]:
        """Simulations of the `verdict` under way, and their maximum; may be asked meanwhile."""
        return dict(zip(("evaluations", "most"), self._searched, strict=True))

    @_question
    def scenario(self, name: str) -> dict[str, Any]:
        """The `setup` after another shipped scenario was asked of the healthy twin."""
        if self.recorded:
            raise InputError("A recording has its own command; explore without one instead.")
        self._take(self._simulated(_one_of(self.model.scenarios(), name, "name")))
        return self.setup()

    # How they are answered

    def _still_wanted(self, evaluations: int, cost: float, budget: int) -> None:
        self._searched = (evaluations, budget)
        if self.stopped.is_set():
            raise StoppedError

    def _at(self, values: Mapping[str, float], fitted: bool) -> dict[str, float]:
        """All values that are not healthy, once each of a slider is within its bounds."""
        at = dict(self._fitted) if fitted else {}
        for name, value in values.items():
            at[name] = self.unknowns[_one_of(self.unknowns, name, "A slider")].check(value)
        return at

    def _batch(self, at: Mapping[str, Any], count: int) -> dict[str, np.ndarray]:
        """Candidates (B,) at values, each one for all of them or (B,)."""
        healthy = {name: one.healthy for name, one in self.unknowns.items()}
        return {name: np.full(count, value) for name, value in {**healthy, **at}.items()}

    def _response(self, at: Mapping[str, float]) -> dict[str, np.ndarray]:
        found = self._comparison.responses(self._batch(at, 1), 1)
        return {name: rows[0] for name, rows in found.items()}

    def _misfits(self, at: Mapping[str, Any], count: int = 1) -> list[float]:
        """Relative misfits of candidates; infinite where the twin diverged."""
        costs = self._comparison.costs(self._batch(at, count), count)
        return [self._problem.relative_misfit(cost) for cost in costs]

    def _traced(self, title: str, unit: str, **traces: np.ndarray) -> dict[str, Any]:
        """Traces (S,) of a channel by name, in the unit in which they are shown."""
        shown, factor = preferred(unit)
        told = {name: factor * trace[self._kept] for name, trace in traces.items()}
        return {"title": capital(title), "unit": in_unit("", shown).strip(), **told}

    def _said(self, one: Unknown, at: Mapping[str, float]) -> str:
        """A value in its physical unit: "0.045 N m"."""
        row = one.physical_value(self.actuator, at.get(one.name, one.healthy))
        return said(row.value, row.unit)

    def _slider(self, one: Unknown) -> dict[str, Any]:
        source = self.recording.provenance
        known = self.recorded and source.get("source") == "simulated"
        truth = (source.get("faults") or {}).get(one.name) if known else None
        return {
            "name": one.name, "title": one.name.replace("_", " ").capitalize(),
            "meaning": capital(one.meaning), "fault": one.role == "fault", "lower": one.lower,
            "upper": one.upper, "healthy": one.healthy, "logarithmic": one.logarithmic,
            "ends": [self._said(one, {one.name: x}) for x in (one.lower, one.upper)],
            "truth": truth if truth is not None and one.lower <= truth <= one.upper else None,
        }  # fmt: skip


def answered(explorer: Explorer, question: Any) -> dict[str, Any]:
    """The answer to ``{"ask": one of QUESTIONS, ...}``, or ``{"error": sentence}``; plain for JSON.

    One at a time, but for progress: an explorer keeps no lock.
    """
    try:
        if not isinstance(question, Mapping):
            raise InputError("A question must be a mapping.")
        asked = {name: given for name, given in question.items() if name not in ("ask", "id")}
        what = _one_of(QUESTIONS, question.get("ask"), "ask")
        return dict(plain(getattr(explorer, what)(**asked)))
    except ValidationError as error:
        first = error.errors()[0]
        return {"error": f"{'.'.join(str(part)[:40] for part in first['loc'])}: {first['msg']}."}
    except EmatwinError as error:
        return {"error": str(error)}


def _one_of(known: Collection[str], given: Any, what: str) -> str:
    if given not in known:
        raise InputError(f"{what} must be one of {', '.join(known)}.")
    return str(given)
