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
    finding = error.errors()[0]
    place = ".".join(str(part) for part in finding["loc"])
    more = len(error.errors()) - 1
    tail = f" ({more} more of this kind.)" if more else ""
    kind = finding["type"]
    if kind == "extra_forbidden":
        text = f"{place} is not a name that {what} knows; remove it or correct its spelling"
    elif kind == "missing":
        text = f"{place} is missing; add it"
    elif kind == "value_error":
        text = f"{place + ': ' if place else ''}{finding['ctx']['error']}"
    else:
        message = finding["msg"].replace("Input should be", "must be")
        text = f"{place} {message}, received {finding['input']!r}; correct it"
    return ParameterError(f"{what}: {text.rstrip('.')}.{tail}")
