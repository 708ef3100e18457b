"""Completion of option values in the shell: names, looked up when they are asked for.

The shell waits meanwhile: nothing is imported before, and no error ever reaches its prompt.
"""

from collections.abc import Callable, Iterable


def _completion(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    def starting(incomplete: str) -> list[str]:
        try:
            return sorted(name for name in names() if name.startswith(incomplete))
        except Exception:  # such as a broken package that adds an actuator
            return []

    return starting


@_completion
def actuators() -> Iterable[str]:
    """Shipped parameter sets; the shell itself completes the names of files."""
    from ematwin.models.registry import shipped_actuators

    return shipped_actuators()


@_completion
def scenarios() -> Iterable[str]:
    """Shipped scenarios of all kinds."""
    from ematwin.models.registry import models

    return {name for model in models().values() for name in model.scenarios()}


@_completion
def algorithms() -> Iterable[str]:
    """Search methods."""
    from ematwin.estimation.search import methods

    return [method.name for method in methods()]


@_completion
def _presets() -> Iterable[str]:
    from ematwin.optimizers.registry import PRESETS

    return PRESETS


def several_algorithms(incomplete: str) -> list[str]:
    """Search methods and presets with commas between them."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in [*algorithms(last), *_presets(last)]]
