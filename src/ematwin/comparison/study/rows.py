"""Runs as rows of a database and back, exact to the last bit."""

import json
import math
import zlib
from collections.abc import Callable, Mapping
from typing import Any

from ematwin.comparison.study.history import PackedHistory, pack
from ematwin.comparison.study.run import RunResult, RunSpec, StoredRun
from ematwin.comparison.study.seal import (
    NUMBERS,
    DamagedError,
    called,
    document_key,
    row_checksum,
)

SHARED = ("population", "iterations", "noise", "actuator", "scenario", "box", "model")


def settings_of(spec: RunSpec) -> dict[str, Any]:
    """The part of a run's inputs that it shares with the others of its study."""
    return {name: getattr(spec, name) for name in SHARED}


def document(value: Mapping[str, Any]) -> tuple[str, str]:
    """Key and JSON text of values that many runs share."""
    text = json.dumps(value, sort_keys=True)
    return document_key(text), text


def row_of(one: StoredRun) -> dict[str, Any]:
    """A run as a row, with its checksum."""
    spec, result = one.spec, one.result
    row = {
        "id": spec.id,
        "case_name": str(spec.case),
        "faults": json.dumps(spec.faults),
        "algorithm": str(spec.algorithm),
        "run": int(spec.run),
        "seed": int(spec.seed),
        "record_seed": int(spec.record_seed),
        "settings": document(settings_of(spec))[0],
        "status": str(result.status),
        "found": json.dumps(result.faults),
        **{name: _or_null(getattr(result, name)) for name in NUMBERS},
        "evaluations": int(result.evaluations),
        "history": pack(result.history),
        # no database takes NUL or half of a surrogate pair, which messages of failures may hold
        "stopped": result.stopped.replace("\0", "").encode("utf-8", "replace").decode(),
        "provenance": document(result.provenance)[0],
    }
    return {**row, "checksum": row_checksum(row)}


class RowReader:
    """Turns rows into runs; what many of them share is one object in memory.

    Parameters
    ----------
    read : gives the text of the document of a key, or None
    sealed : whether each row has a checksum; those of 0.1 have none
    """

    def __init__(self, read: Callable[[str], str | None], sealed: bool = True) -> None:
        self._read = read
        self._sealed = sealed
        self._documents: dict[str, Any] = {}
        self._texts: dict[str, Any] = {}

    def stored(self, row: Mapping[str, Any]) -> StoredRun:
        """The run of a row.

        Raises
        ------
        DamagedError
            If it is not as it was written.
        """
        if self._sealed:
            if row["checksum"] != row_checksum(row):
                raise DamagedError(f"{called(row)} differs from its checksum")
            return self._made(row)
        try:
            one = self._made(row)
            one.result.history[:1]  # packed with a checksum of its own
            if not isinstance(one.spec.run, int) or not isinstance(one.result.cost, float):
                raise TypeError
        except (ValueError, TypeError, KeyError, AttributeError, zlib.error):
            raise DamagedError(f"{called(row)} cannot be read") from None
        return one

    def _made(self, row: Mapping[str, Any]) -> StoredRun:
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
            **{name: math.nan if row[name] is None else float(row[name]) for name in NUMBERS},
            evaluations=row["evaluations"],
            history=PackedHistory(bytes(row["history"])),
            stopped=self._text(row["stopped"]),
            provenance=self._document(row["provenance"]),
        )
        return StoredRun(spec, result)

    def _document(self, key: str) -> Any:
        if key not in self._documents:
            text = self._read(key)
            if text is None or document_key(text) != key:
                raise DamagedError(f"the document {key}, which runs share, differs from its hash")
            self._documents[key] = json.loads(text)
        return self._documents[key]

    def _vector(self, text: str) -> Any:
        if text not in self._texts:
            self._texts[text] = tuple(json.loads(text))
        return self._texts[text]

    def _text(self, text: str) -> Any:
        return self._texts.setdefault(text, text)


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
