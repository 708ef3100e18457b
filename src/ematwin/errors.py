"""The errors that ematwin raises on purpose, and the check that most callers need.

Every message states the error, the value received and the remedy in one or two sentences.
The command line prints it without a traceback and exits with code 2.
"""

from numbers import Integral


class EmatwinError(Exception):
    """Base of every error that ematwin raises on purpose."""


class InputError(EmatwinError, ValueError):
    """A value from outside cannot be used: an argument, an option, a fault, a budget."""


class ParameterError(InputError):
    """An actuator or scenario is impossible or incomplete."""


class RecordError(InputError):
    """A recording cannot be used as it is."""


class FileError(EmatwinError, OSError):
    """A file cannot be read or written."""


class MissingExtraError(EmatwinError, ImportError):
    """An optional dependency is not installed; the message names the command that installs it."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed. "
            f'Run: pip install "ematwin[{extra}]".'
        )


class DivergedError(EmatwinError):
    """A single simulation left the finite numbers. Within a batch this is a status instead."""


def whole_number(value: object, name: str, least: int) -> int:
    """Check that a value is an integer of at least ``least``; ``name`` begins the sentence."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{name} must be a whole number of at least {least}, received {value!r}.")
    return int(value)
