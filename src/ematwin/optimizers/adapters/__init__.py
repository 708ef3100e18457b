"""Optimisers of other libraries behind the same ask and tell.

Nothing here imports such a library before one of its algorithms is made.
"""

from collections.abc import Callable
from typing import Any

from ematwin.optimizers.base import Algorithm, OptimizerFactory


def adapted(
    name: str,
    title: str,
    source: str,
    library: str,
    load: Callable[[], OptimizerFactory],
    departures: str,
    **more: Any,
) -> Algorithm:
    """Describe an algorithm of a library, with the library's settings."""
    return Algorithm(
        name, title, source, library, load, requires=library, departures=departures,
        tuned_on="nothing here: the library's own settings", **more,
    )  # fmt: skip
