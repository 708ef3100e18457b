"""Runs as rows of a database and back, exact to the last bit."""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from ematwin.comparison.study.history import PackedHistory, pack
from ematwin.comparison.study.run import RunResult, RunSpec, StoredRun

_SHARED = ("population", "iterations", "noise", "actuator", "scenario", "box", "model")
_NUMBERS = ("cost", "relative_misfit", "err", "err_wrapped", "seconds", "cpu_seconds")


def settings_of(spec: RunSpec) -> dict[str, Any]:
    """The part of a run's inputs that it shares with the others of its study."""
    return {name: getattr(spec, name) for name in _SHARED}


def document(value: Mapping[str, Any]) -> tuple[str, str]:
    """Key and JSON text of values that many runs share."""
    text = json.dumps(value, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24], text


def row_of(one: StoredRun) -> dict[str, Any]:
    """A run as a row."""
    spec, result = one.spec, one.result
    return {
        "id": spec.id,
        "case_name": spec.case,
        "faults": json.dumps(spec.faults),
        "algorithm": spec.algorithm,
        "run": spec.run,
        "seed": spec.seed,
        "record_seed": spec.record_seed,
        "settings": document(settings_of(spec))[0],
        "status": result.status,
        "found": json.dumps(result.faults),
        **{name: _or_null(getattr(result, name)) for name in _NUMBERS},
        "evaluations": result.evaluations,
        "history": pack(result.history),
        "stopped": result.stopped.replace("\0", ""),
        "provenance": document(result.provenance)[0],
    }


class RowReader:
    """Turns rows into runs; what many of them share is one object in memory.

    Parameters
    ----------
    read : gives the document of a key
    """

    def __init__(self, read: Callable[[str], Any]) -> None:
        self._read = read
        self._documents: dict[str, Any] = {}
        self._texts: dict[str, Any] = {}

    def stored(self, row: Mapping[str, Any]) -> StoredRun:
        """The run of a row."""
        spec = RunSpec(
            case=self._text(row["case_name"]),
            faults=self._vector(row["faults"]),
            algorithm=self._text(row["algorithm"]),
            run=row["run"],
            seed=row["seed"],
            record_seed=row["record_seed"],
            **self._document(row["settings"]),
        )
        # the id is the key of the row: hashing 100,000 of them again would take half a minute
        spec.__dict__["id"] = row["id"]
        result = RunResult(
            id=row["id"],
            status=self._text(row["status"]),
            faults=tuple(json.loads(row["found"])),
            **{name: math.nan if row[name] is None else row[name] for name in _NUMBERS},
            evaluations=row["evaluations"],
            history=PackedHistory(bytes(row["history"])),
            stopped=self._text(row["stopped"]),
            provenance=self._document(row["provenance"]),
        )
        return StoredRun(spec, result)

    def _document(self, key: str) -> Any:
        if key not in self._documents:
            self._documents[key] = self._read(key)
        return self._documents[key]

    def _vector(self, text: str) -> Any:
        if text not in self._texts:
            self._texts[text] = tuple(json.loads(text))
        return self._texts[text]

    def _text(self, text: str) -> Any:
        return self._texts.setdefault(text, text)


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
