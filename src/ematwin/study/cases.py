"""Cases of a study: named fault vectors, of the paper, at random, or from a file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ematwin.errors import InputError
from ematwin.faults import PAPER_CASES, Faults
from ematwin.validation import load_toml

Cases = dict[str, tuple[float, ...]]

DEFAULT_COUNT = 50

# Magnitudes that a random fault may have: from barely worth a look to severe. The gain lies so
# far on either side of healthy.
_RANGES = {
    "friction": (0.1, 1.0),
    "backlash": (0.05, 1.0),
    "short_a": (0.1, 0.9),
    "short_b": (0.1, 0.9),
    "short_c": (0.1, 0.9),
    "eccentricity": (0.1, 0.9),
    "gain": (0.1, 0.5),
}
_FEWEST, _MOST = 2, 4  # faults at once


def cases_of(text: str, *, count: int | None = None, seed: int = 1) -> Cases:
    """The cases that ``--cases`` names.

    Parameters
    ----------
    text : "paper" (Table 1), "multi" (random vectors with two to four faults), or a TOML file
        with a table ``[cases."name"]`` of fault magnitudes for each case
    count : int, of random cases; more of them leave the first ones as they were
    seed : int, of the random cases

    Raises
    ------
    InputError
        If there are no such cases.
    """
    if count is not None and text != "multi":
        raise InputError(f"--count belongs to --cases multi, received --cases {text}.")
    if text == "paper":
        return {name: _vector(values) for name, values in PAPER_CASES.items()}
    if text == "multi":
        return multi_cases(DEFAULT_COUNT if count is None else count, seed)
    if text.lower().endswith(".toml") or Path(text).is_file():
        return cases_from_file(Path(text))
    raise InputError(f"There are no cases {text!r}; choose paper, multi or a TOML file.")


def multi_cases(count: int, seed: int) -> Cases:
    """Random cases with several faults at once (the paper's future work)."""
    if count < 1:
        raise InputError(f"The number of cases must be at least 1, received {count}.")
    return {f"Multi {n + 1:03d}": _random_vector(seed, n) for n in range(count)}


def cases_from_file(path: Path) -> Cases:
    """Cases of a TOML file: one table ``[cases."name"]`` each, what is not given is healthy."""
    table = load_toml(path, "cases")
    found = table.get("cases")
    extra = [key for key in table if key != "cases"]
    if not isinstance(found, dict) or not found or extra:
        what = f"received {extra[0]!r}" if extra else "there is none"
        raise InputError(
            f'{path} must hold tables [cases."name"] of fault magnitudes and nothing else; {what}.'
        )
    cases = {}
    for name, values in found.items():
        if not isinstance(values, dict):
            raise InputError(
                f"Case {name!r} of {path} must be a table such as friction = 0.3, received "
                f"{values!r}."
            )
        try:
            cases[str(name)] = _vector(values)
        except InputError as error:
            raise InputError(f"Case {name!r} of {path}: {error}") from None
    return cases


def _vector(values: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(Faults.of(values).vector.tolist())


def _random_vector(seed: int, n: int) -> tuple[float, ...]:
    rng = np.random.default_rng(np.random.SeedSequence([seed, n]))
    names = rng.choice(list(_RANGES), size=rng.integers(_FEWEST, _MOST + 1), replace=False)
    values = {}
    for name in sorted(str(name) for name in names):
        magnitude = round(float(rng.uniform(*_RANGES[name])), 3)
        if name == "gain":
            magnitude = round(0.5 + float(rng.choice([-1.0, 1.0])) * magnitude, 3)
        values[name] = magnitude
        if name == "eccentricity":
            values["eccentricity_phase"] = round(float(rng.uniform(0.0, 1.0)), 3)
    return _vector(values)
