"""From a TOML file to checked values, and from pydantic's findings to one sentence."""

import difflib
import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ematwin.errors import EmatwinError, FileError, ParameterError

_LISTED = 12  # problems of a file that one message lists; more would hide the first ones


def load_toml(path: Path, kind: str) -> dict[str, Any]:
    """The content of a TOML file; `FileError` if it cannot be read, `ParameterError` if no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"Cannot read the {kind} file {path}: {error.strerror}.") from None
    except UnicodeDecodeError:
        said = f"The {kind} file {path} is not text"
        raise ParameterError(f"{said}; a TOML file is needed.") from None
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"The {kind} file {path} is not valid TOML: {error}.") from None


def checksum_of(table: Mapping[str, Any]) -> str:
    """Checksum of the values of a TOML file; name, description and comments do not count."""
    values = {key: one for key, one in table.items() if key not in ("name", "description")}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def refuse_newer(
    what: str, written: Any, known: int, error: type[EmatwinError] = ParameterError
) -> None:
    """Refuse what a newer ematwin wrote, with a format above the one that is ``known``."""
    if isinstance(written, int) and written > known:
        raise error(
            f"{what} was written by a newer ematwin (format {written}, this one knows {known}). "
            "Update ematwin."
        )


@contextmanager
def damage_said(
    what: str, advice: str, error: type[EmatwinError] = ParameterError
) -> Iterator[None]:
    """Raise the ``error`` with some advice where a table has other contents than it should."""
    try:
        yield
    except EmatwinError:
        raise
    except (
        KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError
    ) as found:  # fmt: skip
        raise error(f"{what} is damaged ({type(found).__name__}: {found}). {advice}") from None


def one_sentence(error: ValidationError, what: str) -> ParameterError:
    """The first finding of a validation, as a sentence for people."""
    found = findings(error, what)
    more = len(found) - 1
    tail = f" There {'is' if more == 1 else 'are'} {more} more to correct." if more else ""
    return ParameterError(f"{what}: {found[0][1]}{tail}")


def all_at_once(sentences: Sequence[str], what: str) -> ParameterError:
    """Everything that is wrong with a file, in one message; a single problem as it is."""
    if len(sentences) == 1:
        return ParameterError(f"{what}: {sentences[0]}")
    listed = " ".join(f"({n}) {text}" for n, text in enumerate(sentences[:_LISTED], start=1))
    more = len(sentences) - _LISTED
    tail = f" And {more} more." if more > 0 else ""
    return ParameterError(f"{what} needs {len(sentences)} corrections: {listed}{tail}")


def findings(error: ValidationError, what: str) -> list[tuple[str, str]]:
    """Place and sentence of each finding of a validation; misspelt names first."""
    # a misspelt name comes with the complaint that the right one is missing: the cause first
    ordered = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    return [_finding(one, what) for one in ordered]


def _finding(finding: Any, what: str) -> tuple[str, str]:
    places = [str(part) for part in finding["loc"]]
    kind = finding["type"]
    cause = finding.get("ctx", {}).get("error")
    if isinstance(cause, ParameterError):
        places = places[:-1]  # the last one is the kind of the part, which the cause names
    place = ".".join(places)
    if kind == "extra_forbidden":
        text = unknown_name(place, what)
    elif kind == "missing":
        text = f"{place} is missing; add it"
    elif kind == "value_error":
        text = f"{place + ': ' if place else ''}{cause}"
    elif kind == "union_tag_not_found":
        text = f"{place} has no type, received {finding['input']!r}; add its type"
    elif kind == "union_tag_invalid":
        known = finding["ctx"]["expected_tags"]
        text = f"{place} has the type {finding['ctx']['tag']!r}; choose one of {known}"
    elif kind in {"model_type", "model_attributes_type", "dict_type"}:
        text = f"{place} must be a table, received {shortened(finding['input'])}; correct it"
    else:
        message = finding["msg"].replace("Input should be", "must be")
        text = f"{place} {message}, received {finding['input']!r}; correct it"
    return place, f"{text.rstrip('.')}."


def shortened(received: object) -> str:
    """A received value as Python writes it; cut where it is longer than a line or two."""
    text = repr(received)
    return text if len(text) <= 160 else f"{text[:160]}..."  # characters of what was received


def unknown_name(place: str, what: str, meant: str = "") -> str:
    """The sentence on an unknown name; ``meant`` is the name that was probably meant."""
    advice = f"correct its spelling to {meant}" if meant else "remove it or correct its spelling"
    return f"{place} is not a name that {what} knows; {advice}."


def misspelt(given: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """Unknown names and the known one that each is closest to, among those that are not given."""
    given, known = list(given), list(known)
    absent = [name for name in known if name not in given]
    found = {}
    for name in given:
        close = [] if name in known else difflib.get_close_matches(name, absent, n=1)
        if close:
            found[name] = close[0]
            absent.remove(close[0])
    return found
