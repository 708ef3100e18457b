"""Completion of option values in the shell: names, looked up when they are asked for.

The shell waits meanwhile: nothing is imported before, and no error ever reaches its prompt.
"""

from collections.abc import Callable, Iterable


def actuators(incomplete: str) -> list[str]:
    """Shipped parameter sets; the shell itself completes the names of files."""

    def names() -> Iterable[str]:
        from ematwin.models.registry import shipped_actuators

        return shipped_actuators()

    return _starting(incomplete, names)


def scenarios(incomplete: str) -> list[str]:
    """Shipped scenarios of all kinds."""

    def names() -> Iterable[str]:
        from ematwin.models.registry import models

        return {name for model in models().values() for name in model.scenarios()}

    return _starting(incomplete, names)


def algorithms(incomplete: str) -> list[str]:
    """Search methods."""

    def names() -> Iterable[str]:
        from ematwin.estimation.search import methods

        return [method.name for method in methods()]

    return _starting(incomplete, names)


def several_algorithms(incomplete: str) -> list[str]:
    """Search methods and presets with commas between them."""

    def names() -> Iterable[str]:
        from ematwin.optimizers.registry import PRESETS

        return PRESETS

    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in [*algorithms(last), *_starting(last, names)]]


def _starting(incomplete: str, names: Callable[[], Iterable[str]]) -> list[str]:
    try:
        return sorted(name for name in names() if name.startswith(incomplete))
    except Exception:  # such as a broken package that adds an actuator
        return []
