"""A detection made up from values: verdicts of every grade, without a recording or a search."""

from types import SimpleNamespace
from typing import Any

import ematwin
from ematwin.models.registry import model_of
from ematwin.monitoring.detect import Detection, Magnitude, Verdict

_GRADES = ("healthy", "changed", "fault", "none", "fault", "healthy")
_FAULTS = ("", "", "lubrication", "", "backlash", "")


def detection(count: int, dated: bool = False) -> Detection:
    """As many runs as are asked for, healthy and not."""
    actuator = ematwin.load_actuator("rm1605")
    model = model_of(actuator)
    facts = {"runs": ["1", "2", "3"], "sources": ["healthy.csv"], "held_back": [],
             "undetermined": []}  # fmt: skip
    calibration: Any = SimpleNamespace(
        actuator=actuator, model=model, facts=facts, signatures=(),
        thresholds=SimpleNamespace(false_alarm_rate=0.01),
    )  # fmt: skip
    reported = model.reported(actuator)
    verdicts = []
    for n in range(count):
        grade, fault = _GRADES[n % 6], _FAULTS[n % 6]
        magnitudes = tuple(
            Magnitude(one.name, one.unit, 1.0 + 0.1 * n, 0.9 + 0.1 * n, 1.1 + 0.1 * n, (0.8, 1.2),
                      float(n))
            for one in reported
        )  # fmt: skip
        verdicts.append(
            Verdict(
                name=f"run {n + 1}", labels={"run": str(n + 1)}, motions=1, magnitudes=magnitudes,
                covariate=None, index=1.0 + n, threshold=3.0, clear=6.0, fault=fault,
                named_by="physics" if fault else "", grade=grade, alarm=bool(fault),
                reason="Because <it> is so.",
                when=f"2026-11-{n + 1:02d}T08:00:00" if dated else None,
            )
        )  # fmt: skip
    return Detection(tuple(verdicts), tuple(verdicts), calibration)
