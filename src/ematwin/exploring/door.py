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


def _setup(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    return explorer.setup()


def _traces(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    return explorer.traces(_one_of(explorer.channels, question, "channel"))


def _answer(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    channel = _one_of(explorer.channels, question, "channel")
    return explorer.answer(_values(explorer, question), channel, _flag(question))


def _profile(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    along = _one_of(explorer.unknowns, question, "along")
    return explorer.profile(_values(explorer, question), along, _flag(question))


def _fit(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    return explorer.fit(_values(explorer, question), _flag(question))


def _verdict(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    return explorer.verdict()


def _progress(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    return explorer.progress()


def _scenario(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    explorer.choose(_one_of(explorer.model.scenarios(), question, "name"))
    return explorer.setup()


_REPLIES: Mapping[str, Callable[[Explorer, Mapping[str, Any]], dict[str, Any]]] = {
    "setup": _setup,
    "traces": _traces,
    "answer": _answer,
    "profile": _profile,
    "fit": _fit,
    "verdict": _verdict,
    "progress": _progress,
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
