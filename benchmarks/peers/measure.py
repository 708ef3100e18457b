"""Figures of one part of the comparison: repeated, in turn with ematwin, with their spread."""

import importlib.metadata
import importlib.util
import math
import platform
import re
import shutil
import statistics
import subprocess
import sys
import time
import timeit
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from ematwin.numerics.side_by_side import cores


@dataclass(frozen=True)
class Line:
    """A competitor's figures.

    Attributes
    ----------
    name : as it stands in the table
    values : figures of the repeats, in the unit of the part; empty if it was not timed
    ratios : the same over ematwin's, measured beside each
    more : cells of further columns
    own : whether this is ematwin
    """

    name: str
    values: tuple[float, ...]
    ratios: tuple[float, ...]
    more: tuple[str, ...] = ()
    own: bool = False

    @property
    def middle(self) -> float:
        """Median, or infinite where most repeats failed."""
        return statistics.median(self.values) if self.values else math.nan

    def cells(self) -> list[str]:
        """Name, median, spread, ratio and what else there is."""
        if not self.values:
            return [self.name, "not timed", "", "", *self.more]
        low, high = number(min(self.values)), number(max(self.values))
        ratio = statistics.median(self.ratios) if self.ratios else math.nan
        return [
            self.name,
            number(self.middle),
            low if low == high else f"{low} to {high}",
            "" if math.isnan(ratio) else number(ratio),
            *self.more,
        ]


@dataclass(frozen=True)
class Part:
    """One question, its figures, and what is to be known of them.

    Attributes
    ----------
    remarks : sentences: who is missing, who disagrees
    versions : of what was compared, by name
    """

    heading: str
    question: str
    unit: str
    ratio: str  # heading of the column of ratios
    columns: tuple[str, ...]  # headings of `Line.more`
    lines: tuple[Line, ...]
    remarks: tuple[str, ...] = ()
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def header(self) -> list[str]:
        """Headings of all columns."""
        return ["", f"median, {self.unit}", "spread", self.ratio, *self.columns]


def number(value: float) -> str:
    """Three digits."""
    if not math.isfinite(value):
        return "not reached"
    if value == 0.0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}" if digits < 6 else f"{value:.2g}"


def seconds(work: Callable[[], object]) -> float:
    """How long one call takes."""
    return timeit.timeit(work, number=1)


def in_turn(
    peer: Callable[[], object], own: Callable[[], object], repeats: int, patience: float
) -> list[tuple[float, float]]:
    """Seconds of both, measured in turn: a change of the machine's speed then meets both.

    Ends before ``repeats`` when ``patience`` (s) is over.
    """
    found: list[tuple[float, float]] = []
    started = time.perf_counter()
    while len(found) < repeats and (not found or time.perf_counter() - started < patience):
        found.append((seconds(peer), seconds(own)))
    return found


def versions(*packages: str) -> dict[str, str]:
    """Of those packages that are installed."""
    found = {}
    for name in packages:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def program_version(program: str) -> dict[str, str]:
    """The version that ``program --version`` prints, by its name; empty if there is none."""
    path = shutil.which(program)
    if path is None:
        return {}
    done = subprocess.run([path, "--version"], capture_output=True, text=True)
    for line in (done.stdout + done.stderr).splitlines():
        if numbers := re.findall(r"\d+(?:\.\d+)*", line):
            return {program: numbers[-1]}
    return {program: "unknown"}


def missing(module: str, install: str, what: str) -> str:
    """One sentence if a module cannot be found, else an empty text."""
    if importlib.util.find_spec(module) is not None:
        return ""
    return f"{what} is left out: {module} is not installed (pip install {install})."


def machine() -> str:
    """Processor, cores and Python, in one sentence."""
    name = platform.processor() or platform.machine()
    return f"{name}, {cores()} cores, Python {platform.python_version()}"


def progress(text: str) -> None:
    """Say what is done now, on one line of a terminal or as lines elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    else:
        print(text, file=sys.stderr, flush=True)


def end_progress() -> None:
    """Clear the line of progress."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
