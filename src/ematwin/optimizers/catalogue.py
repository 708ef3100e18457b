"""What is known of an algorithm before it runs: name, source, departures, what it needs."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

from ematwin.errors import MissingExtraError
from ematwin.optimizers.base import OptimizerFactory

EXTRA = "bench"


@dataclass(frozen=True)
class Algorithm:
    """An algorithm that can be named.

    Attributes
    ----------
    name : str
    title : str
    source : str, the paper or library that it follows
    departures : str, where it leaves its source; "none", or "not checked" where nobody looked
    tuned_on : str, what its settings were chosen on, where not by its source
    origin : str, "ematwin", the library that an adapter drives, or the package of an entry point
    load : callable, gives the factory; imports no other library
    requires : str or None, package to import; None if it comes with ematwin
    aliases : tuple of str
    """

    name: str
    title: str
    source: str
    origin: str
    load: Callable[[], OptimizerFactory]
    requires: str | None = None
    aliases: tuple[str, ...] = ()
    departures: str = "not checked"
    tuned_on: str = "not known"

    @property
    def installed(self) -> bool:
        """Whether the library it needs can be found; nothing is imported."""
        return self.requires is None or importlib.util.find_spec(self.requires) is not None

    def factory(self) -> OptimizerFactory:
        """Give what makes the optimiser.

        Raises
        ------
        MissingExtraError
            If the library it needs is not installed.
        """
        if not self.installed:
            raise MissingExtraError(str(self.requires), EXTRA, f"The algorithm {self.name!r}")
        return self.load()
