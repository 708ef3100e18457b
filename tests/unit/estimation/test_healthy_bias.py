"""How far healthy recordings are found off healthy, on an actuator worked out by hand.

It answers with ``1 + wear`` on one basis and with ``slip`` on another.
"""

import numpy as np
import pytest

from ematwin.errors import RecordError
from ematwin.estimation.baseline import Baseline
from ematwin.estimation.healthy_bias import healthy_bias
from ematwin.estimation.prior import Prior
from ematwin.models.unknown import Unknown
from naive.toy import OneChannel

NOISE, SAMPLES = 0.01, 200
_T = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
BASES = np.sqrt(2.0) * np.array([np.sin(_T), np.sin(2.0 * _T)])  # RMS of 1
SHARP = NOISE / np.sqrt(SAMPLES)


class Beside(OneChannel):
    """A recording beside the twin."""

    def __init__(self, y: np.ndarray) -> None:
        super().__init__(y, NOISE)

    def responses(self, candidates, count):
        wear, slip = (np.broadcast_to(candidates.get(n, 0.0), count) for n in ("wear", "slip"))
        return {"y": np.stack([1.0 + wear, slip], axis=-1) @ BASES}


def run(wear: float, slip: float = 0.0, seed: int = 0) -> Beside:
    """What shows so much of each, and noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(SAMPLES)
    return Beside(np.array([1.0 + wear, slip]) @ BASES + noise)


class Kind:
    """What is asked of a kind."""

    default_search, model_error, monitoring = "levenberg-marquardt", 1.0, None
    lacking_error = None

    def faults(self, actuator):
        return (
            Unknown("wear", "", "", 0.0, 0.0, 2.0, slack=0.5),
            Unknown("slip", "", "", 0.0, 0.0, 1.0),
        )

    unknowns = faults

    def aliases(self, actuator, values):
        return []

    def contrasts(self, actuator):
        return ()

    def compare(self, recording, actuator):
        return Beside(recording.y)


class Actuator:
    """Nothing of it is uncertain."""

    def drift(self, place):
        return None

    def with_arrays(self, values):
        return self


def off(*runs: Beside) -> dict[str, float]:
    known = Baseline(Prior.independent([]), recordings=len(runs))
    return healthy_bias(Kind(), Actuator(), known, runs, [{}] * len(runs))  # type: ignore[arg-type]


def test_of_a_twin_that_lacks_nothing_only_noise_is_left() -> None:
    found = off(*(run(0.0, seed=seed) for seed in range(3)))
    assert found["wear"] < 3.0 * SHARP
    assert found["slip"] < 3.0 * SHARP


def test_what_is_off_in_all_healthy_recordings_alike_counts_whole() -> None:
    found = off(*(run(0.1, seed=seed) for seed in range(3)))
    assert found["wear"] == pytest.approx(0.1, abs=5.0 * SHARP)
    assert found["slip"] < 3.0 * SHARP


def test_better_than_healthy_counts_too() -> None:
    assert off(run(-0.1))["wear"] == pytest.approx(0.1, abs=5.0 * SHARP)


def test_what_they_differ_by_is_added() -> None:
    wear = np.array([0.05, 0.1, 0.12])
    found = off(*(run(x, seed=seed) for seed, x in enumerate(wear)))
    assert found["wear"] == pytest.approx(np.hypot(wear.mean(), wear.std(ddof=1)), rel=0.1)


def test_a_recording_unlike_the_others_is_refused() -> None:
    with pytest.raises(
        RecordError, match=r"Recording 3 of 3 is unlike .* its wear differs .*\+0\.5"
    ):
        off(run(0.0), run(0.0, seed=1), run(0.5, seed=2))


def test_of_two_that_differ_neither_is_the_odd_one() -> None:
    assert off(run(0.0), run(0.5, seed=1))["wear"] > 0.25
