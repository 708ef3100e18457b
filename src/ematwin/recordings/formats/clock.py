"""Clock times in text tables: ``2026-11-21 08:00:00.001``, ``03.03.2026 09:14:02,000``.

Also ``11/21/2026 8:00:00 PM`` and ``09:14:02.000050`` without a date. Dates with dots begin with
the day; those with slashes with the month, if the time is of a.m. or p.m. or a number shows it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from ematwin.errors import RecordError

_CLOCK = re.compile(
    r"(?:(\d{4})-(\d\d?)-(\d\d?)[T ]\s*|(\d\d?)([./])(\d\d?)[./](\d{4}),? \s*)?"
    r"(\d\d?):(\d\d):(\d\d)(?:[.,](\d{1,9}))?\s*(?:([AaPp])\.?[Mm]\.?)?\s*(Z|[+-]\d\d:?\d\d)?"
)
MISSING = np.iinfo(np.int64).min


def is_clock(text: str) -> bool:
    """Whether a text is a clock time, with or without a date."""
    return _CLOCK.fullmatch(text.strip()) is not None


@dataclass(frozen=True)
class Clock:
    """How the clock times of a column are written."""

    is_dated: bool  # whether dates stand before the times
    is_utc: bool  # whether they state a time zone, and are brought to UTC
    month_first: bool | None = None  # of dates with slashes; None where there are none

    @classmethod
    def of(cls, texts: Sequence[str]) -> "Clock | None":
        """The clock of a column with these cells; None if none of them is a clock time."""
        found = [match for text in texts if (match := _CLOCK.fullmatch(text.strip()))]
        if not found:
            return None
        slashed = [match for match in found if match[5] == "/"]
        month_first = any(match[12] or int(match[6]) > 12 for match in slashed) and not any(
            int(match[4]) > 12 for match in slashed
        )
        return cls(
            any(match[1] or match[4] for match in found),
            any(match[13] for match in found),
            month_first if slashed else None,
        )

    def nanoseconds(self, texts: Sequence[str | None]) -> np.ndarray:
        """Times (S,), int64, since 1970 or midnight; `MISSING` where a cell is empty."""
        return np.array([self._one(text) for text in texts], dtype=np.int64)

    def _one(self, text: str | None) -> int:
        if text is None or not text.strip():
            return MISSING
        match = _CLOCK.fullmatch(text.strip())
        try:
            if match is None:
                raise ValueError
            year, month, day, first, _, second, later_year = match.groups()[:7]
            if first is not None:
                year, day, month = later_year, first, second
                if self.month_first:
                    day, month = month, day
            on = date(1970, 1, 1) if year is None else date(int(year), int(month), int(day))
            hour, minute, second, fraction, half, zone = match.groups()[7:]
            hours = int(hour)
            if half:
                hours = hours % 12 + (12 if half in "pP" else 0)
            if hours > 23 or int(minute) > 59 or int(second) > 60:
                raise ValueError
        except ValueError:
            raise RecordError(f"{text!r} is no clock time such as 09:14:02.5") from None
        days = (on - date(1970, 1, 1)).days
        seconds = 86_400 * days + 3600 * hours + 60 * int(minute) + int(second) - _offset(zone)
        return seconds * 10**9 + int((fraction or "").ljust(9, "0"))


def _offset(zone: str | None) -> int:
    """Seconds of a time zone such as ``+01:00``."""
    if zone is None or zone == "Z":
        return 0
    digits = zone[1:].replace(":", "")
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return seconds if zone[0] == "+" else -seconds


def over_midnight(seconds: np.ndarray) -> np.ndarray:
    """Times of day (S,), s, counted on where midnight lies between two of them."""
    steps = np.diff(seconds, prepend=seconds[:1])
    past = (steps < 0.0) & (steps + 86_400.0 < 60.0)  # a longer step is none of one recording
    return seconds + 86_400.0 * np.cumsum(past) if past.any() else seconds
