"""The door: every question of a page or widget is checked here, and nowhere else.

A question is a JSON object: ``{"ask": "answer", "values": {...}, ...}``. It can name unknowns,
channels and shipped scenarios that the explorer knows, and give numbers within their bounds.
Nothing else gets through, and no file can be named.
"""

import sys
from collections.abc import Callable, Mapping
from typing import Any

from ematwin.errors import EmatwinError, InputError
from ematwin.exploring.explorer import Explorer


def answered(explorer: Explorer, question: Any) -> dict[str, Any]:
    """The answer to a question, or ``{"error": sentence}``; safe to write as JSON.

    One at a time, but for those that do not `wait`: an explorer keeps no lock.
    """
    try:
        asked = question.get("ask") if isinstance(question, Mapping) else None
        reply = _REPLIES.get(asked) if isinstance(asked, str) else None
        if reply is None:
            raise InputError(f"A question asks for one of {', '.join(_REPLIES)}.")
        return reply(explorer, question)
    except EmatwinError as error:
        return {"error": str(error)}


def waits(question: Any) -> bool:
    """Whether a question waits for the answer to the one before; progress is told meanwhile."""
    return not (isinstance(question, Mapping) and question.get("ask") == "progress")


def _scenario(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    explorer.choose(_one_of(explorer.model.scenarios(), question, "name"))
    return explorer.setup()


def _channel(explorer: Explorer, question: Mapping[str, Any]) -> str:
    return _one_of(explorer.channels, question, "channel")


_REPLIES: Mapping[str, Callable[[Explorer, Mapping[str, Any]], dict[str, Any]]] = {
    "setup": lambda e, _: e.setup(),
    "traces": lambda e, q: e.traces(_channel(e, q)),
    "answer": lambda e, q: e.answer(_values(e, q), _channel(e, q), _flag(q)),
    "profile": lambda e, q: e.profile(_values(e, q), _one_of(e.unknowns, q, "along"), _flag(q)),
    "fit": lambda e, q: e.fit(_values(e, q), _flag(q)),
    "verdict": lambda e, _: e.verdict(),
    "progress": lambda e, _: e.progress(),
    "scenario": _scenario,
}


def _values(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, float]:
    """Values by name, each an unknown and within its bounds."""
    given = question.get("values")
    if not isinstance(given, Mapping):
        raise InputError("values must be an object of names and numbers.")
    found = {}
    for name, value in given.items():
        one = explorer.unknowns.get(name)
        if one is None:
            raise InputError(f"There is no slider {str(name)[:40]!r}.")
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not abs(value) <= sys.float_info.max:  # NaN fails this as well
            raise InputError(f"{name} must be a number, received {str(value)[:40]!r}.")
        found[name] = one.check(value)
    return found


def _one_of(known: Any, question: Mapping[str, Any], what: str) -> str:
    given = question.get(what)
    if not isinstance(given, str) or given not in known:
        raise InputError(f"{what} must be one of {', '.join(known)}.")
    return given


def _flag(question: Mapping[str, Any]) -> bool:
    given = question.get("fitted", False)
    if not isinstance(given, bool):
        raise InputError("fitted must be true or false.")
    return given
