"""Results on arrays that are asked for again, kept by the content of the arrays.

A recording is looked at when it is checked, and again in each comparison with it.
"""

import hashlib
from collections import deque
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

import numpy as np

Answer = TypeVar("Answer")


class Remembered(Generic[Answer]):
    """The latest answers to one question."""

    def __init__(self) -> None:
        self._kept: deque[tuple[bytes, Answer]] = deque(maxlen=8)

    def of(self, arrays: Iterable[np.ndarray], answer: Callable[[], Answer]) -> Answer:
        """What ``answer`` gives, which depends on the arrays alone, and in their order."""
        digest = hashlib.sha256()
        for one in arrays:
            digest.update(np.ascontiguousarray(one).data)
        asked = digest.digest()
        for known, found in tuple(self._kept):
            if known == asked:
                return found
        found = answer()
        self._kept.append((asked, found))
        return found
