"""Estimates travel as JSON; one rule says which faults are present."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from ematwin import Estimate, identify, simulate
from ematwin.errors import InputError


def some(values=(0.3, 0.01, 0.4), errors=(0.01, 0.001, np.inf)):
    names = ("friction", "backlash", "gain")
    return Estimate(
        names,
        np.array(values),
        np.diag(np.array(errors) ** 2),
        units=dict.fromkeys(names, ""),
        healthy={"friction": 0.0, "backlash": 0.0, "gain": 0.5},
        ranges=dict.fromkeys(names, 1.0),
        misfit=0.003,
        actuator="servo48",
        kind="bldc",
        fingerprint="0123",
        held={"short_a": 0.2},
        labels={"run": "3"},
        when="2026-11-21T10:00:00+00:00",
        statistics={"sensor_coupling": 1.5},
        warnings=("doubtful",),
    )


def same(one: Estimate, other: Estimate) -> bool:
    return json.dumps(one.as_dict()) == json.dumps(other.as_dict())


def test_an_estimate_comes_back_from_json_as_it_was() -> None:
    back = Estimate.from_dict(json.loads(json.dumps(some().as_dict(), allow_nan=False)))
    assert same(back, some())
    assert back.standard_errors["gain"] == np.inf
    assert back["short_a"] == 0.2


def test_an_identification_carries_its_estimate() -> None:
    record = simulate("monitor", faults={"friction": 0.3}).changed(
        start=datetime(2026, 11, 21, tzinfo=UTC), labels={"run": "7"}
    )
    found = identify(record, exact=True)
    estimate = Estimate.from_dict(json.loads(json.dumps(found.as_dict()))["estimate"])
    assert estimate["friction"] == found.faults.friction
    assert estimate.when == "2026-11-21T00:00:00+00:00"
    assert (estimate.actuator, estimate.kind, estimate.labels) == ("servo48", "bldc", {"run": "7"})
    assert estimate.fingerprint == found.actuator.fingerprint
    assert np.allclose(estimate.covariance, estimate.covariance.T)
    assert found.present == ("friction",)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": 99}, "newer ematwin"),
        ({"format": "x"}, "not an estimate of ematwin"),
        ({"values": [1.0]}, "not an estimate of ematwin"),
        ({"covariance": None}, "not an estimate of ematwin"),
    ],
)
def test_what_is_no_estimate_is_refused(change: dict, said: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=said):
        Estimate.from_dict({**some().as_dict(), **change})
