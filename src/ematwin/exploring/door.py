"""The door: every question of a page or widget is checked here, and nowhere else.

It can name unknowns, channels and shipped scenarios that the explorer knows, and give numbers
within their bounds. Nothing else gets through, and no file can be named.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, FiniteFloat, ValidationError

from ematwin.errors import EmatwinError, InputError
from ematwin.exploring.explorer import Explorer


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
