"""Whether a store and a plan are of the same study."""

import json
from collections.abc import Mapping
from typing import Any

from ematwin.errors import FileError


def check_same(found: Mapping[str, Any], asked: Mapping[str, Any], where: str) -> None:
    """Raise `FileError` unless both are the settings of one study."""
    for name in dict.fromkeys([*asked, *found]):
        if found.get(name) == asked.get(name):
            continue
        place, old, new = _difference(name, found.get(name), asked.get(name))
        raise FileError(
            f"The store {where} holds another study: its {place} is {old}, received {new}. "
            "Give another --store, or the settings of that study."
        )


def _difference(place: str, old: Any, new: Any) -> tuple[str, str, str]:
    """Where two settings differ, and both values there, shortly."""
    if isinstance(old, dict) and isinstance(new, dict) and old.get("name") == new.get("name"):
        for key in dict.fromkeys([*new, *old]):
            if old.get(key) != new.get(key):
                return _difference(f"{place}.{key}", old.get(key), new.get(key))
    return place, _short(old), _short(new)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return str(value["name"]) if "name" in value else json.dumps(value)
    return f"{value:g}" if isinstance(value, float) else str(value)
