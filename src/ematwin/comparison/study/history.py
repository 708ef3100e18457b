"""Convergence histories, packed: a store of 100,000 runs holds some twenty million pairs."""

import zlib
from collections.abc import Iterator, Sequence
from typing import overload

import numpy as np

Pair = tuple[int, float]


class PackedHistory(Sequence[Pair]):
    """Pairs of evaluations and best cost, unpacked only where they are read.

    Parameters
    ----------
    packed : bytes, of `pack`
    """

    __slots__ = ("packed",)
    __hash__ = None  # type: ignore[assignment]  # it equals tuples, whose hash it has not

    def __init__(self, packed: bytes) -> None:
        self.packed = packed

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Evaluations (B,) int64 and best costs (B,) float64."""
        raw = zlib.decompress(self.packed)
        # bytes of one rank stand together: that packs three times as well
        words = np.frombuffer(raw, np.uint8).reshape(8, -1).T.copy().view("<u8")[:, 0]
        half = words.size // 2
        return np.cumsum(words[:half].view("<i8")), words[half:].view("<f8").copy()

    def __len__(self) -> int:
        return len(self.arrays()[0])

    @overload
    def __getitem__(self, n: int) -> Pair: ...

    @overload
    def __getitem__(self, n: slice) -> tuple[Pair, ...]: ...

    def __getitem__(self, n: int | slice) -> Pair | tuple[Pair, ...]:
        return tuple(self)[n]

    def __iter__(self) -> Iterator[Pair]:
        evaluations, costs = self.arrays()
        return iter(list(zip(evaluations.tolist(), costs.tolist(), strict=True)))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, PackedHistory) and self.packed == other.packed:
            return True
        return tuple(self) == tuple(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        return f"PackedHistory of {len(self)} pairs"


def pack(history: Sequence[Pair]) -> bytes:
    """Pairs as compressed bytes, exact to the last bit."""
    if isinstance(history, PackedHistory):
        return history.packed
    evaluations = np.array([pair[0] for pair in history], "<i8")
    costs = np.array([pair[1] for pair in history], "<f8")
    words = np.concatenate([np.diff(evaluations, prepend=0).view("<u8"), costs.view("<u8")])
    by_rank = words.view(np.uint8).reshape(-1, 8).T.copy()
    return zlib.compress(by_rank.tobytes(), 6)
