"""From a TOML file to checked values, and from pydantic's findings to one sentence."""

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ematwin.errors import FileError, ParameterError


def load_toml(path: Path, kind: str) -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    FileError
        If it cannot be read.
    ParameterError
        If it is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"Cannot read the {kind} file {path}: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise ParameterError(
            f"The {kind} file {path} is not text; a TOML file is needed."
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"The {kind} file {path} is not valid TOML: {error}.") from None


def one_sentence(error: ValidationError, what: str) -> ParameterError:
    """The first finding of a validation, as a sentence for people."""
    # a misspelt name comes with the complaint that the right one is missing: the cause first
    findings = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    finding = findings[0]
    places = [str(part) for part in finding["loc"]]
    more = len(findings) - 1
    tail = f" There {'is' if more == 1 else 'are'} {more} more to correct." if more else ""
    kind = finding["type"]
    cause = finding.get("ctx", {}).get("error")
    if isinstance(cause, ParameterError):
        places = places[:-1]  # the last one is the kind of the part, which the cause names
    place = ".".join(places)
    if kind == "extra_forbidden":
        text = f"{place} is not a name that {what} knows; remove it or correct its spelling"
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
        text = f"{place} must be a table, received {finding['input']!r}; correct it"
    else:
        message = finding["msg"].replace("Input should be", "must be")
        text = f"{place} {message}, received {finding['input']!r}; correct it"
    return ParameterError(f"{what}: {text.rstrip('.')}.{tail}")
