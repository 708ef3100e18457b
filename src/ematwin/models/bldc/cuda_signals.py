"""Signals of stretches on a device: each sent once, all in one array, for as long as it is used."""

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

MOST = 4_000_000  # samples that stay there beside those of a launch: 128 MB


class Signals:
    """The signals that a device holds.

    Attributes
    ----------
    sent : int, how often they were sent
    """

    def __init__(self, most: int = MOST) -> None:
        self.sent = 0
        self._most = most
        self._there: Any = None
        # By the ids of its arrays, the last used last: the arrays and their place. They are kept,
        # so that no other array can get the id of one of them.
        self._known: OrderedDict[tuple[int, ...], tuple[tuple[np.ndarray, ...], int]]
        self._known = OrderedDict()

    def placed(
        self, stretches: Sequence[Any], send: Callable[[np.ndarray], Any]
    ) -> tuple[Any, list[int]]:
        """Signals (4, S) on the device, and the first column of each stretch.

        ``send`` copies an array to the device. The rows are those of
        `ematwin.models.bldc.monitor_thread`.
        """
        arrays = [(one.command, one.load, one.target, one.weights) for one in stretches]
        keys = [tuple(map(id, rows)) for rows in arrays]
        new = dict(zip(keys, arrays, strict=True))
        missing = any(key not in self._known for key in keys)
        for key in new:
            if key in self._known:
                self._known.move_to_end(key)
        if missing:
            self._send_with(new, send)
        return self._there, [self._known[key][1] for key in keys]

    def _send_with(
        self,
        new: Mapping[tuple[int, ...], tuple[np.ndarray, ...]],
        send: Callable[[np.ndarray], Any],
    ) -> None:
        """Send the new ones, and again those of the known ones for which there is room."""
        room = self._most
        kept = []
        for key, (rows, _) in reversed(self._known.items()):
            room -= rows[0].size
            if room < 0:
                break
            if key not in new:
                kept.append((key, rows))
        self._known.clear()
        first = 0
        parts = []
        for key, rows in [*reversed(kept), *new.items()]:
            self._known[key] = (rows, first)
            parts.append(np.stack(rows))
            first += rows[0].size
        self._there = send(np.concatenate(parts, axis=1))
        self.sent += 1
