"""Completion of option values in the shell: names, looked up when they are asked for.

The shell waits meanwhile: nothing is imported before, and no error ever reaches its prompt.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any


def _completion(module: str, names: Callable[[Any], Iterable[str]]) -> Callable[[str], list[str]]:
    """Complete one of the ``names`` that a module of ematwin knows."""

    def starting(incomplete: str) -> list[str]:
        try:
            known = names(import_module(f"ematwin.{module}"))
            return sorted(name for name in known if name.startswith(incomplete))
        except Exception:  # such as a broken package that adds an actuator
            return []

    return starting


# the shell itself completes the names of files
actuators = _completion("models.registry", lambda registry: registry.shipped_actuators())
scenarios = _completion(
    "models.registry",
    lambda registry: {n for m in registry.models().values() for n in m.scenarios()},
)
algorithms = _completion("estimation.search", lambda search: [one.name for one in search.methods()])
_presets = _completion("optimizers.registry", lambda registry: registry.PRESETS)


def several_algorithms(incomplete: str) -> list[str]:
    """Search methods and presets with commas between them."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in [*algorithms(last), *_presets(last)]]
