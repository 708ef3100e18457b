"""Differences that count as none, in double and in single precision."""


class Tolerance(float):
    """A tolerance: a float, and in loops in single precision another one.

    Parameters
    ----------
    double : float, well above the rounding of float64
    single : float, well above the rounding of float32
    """

    single: float

    def __new__(cls, double: float, *, single: float) -> "Tolerance":
        """A float that knows its counterpart."""
        made = super().__new__(cls, double)
        made.single = single
        return made

    def __repr__(self) -> str:
        return f"Tolerance({float(self)!r}, single={self.single!r})"

    def __getnewargs_ex__(self) -> tuple[tuple[float], dict[str, float]]:  # copies and pickles
        return (float(self),), {"single": self.single}
