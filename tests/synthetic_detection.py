"""A detection made up from values: verdicts of every grade, without a recording or a search."""

from types import SimpleNamespace
from typing import Any

import ematwin
from ematwin.estimation.verdict import Verdict
from ematwin.models.registry import model_of
from ematwin.monitoring.detection import Detection, Diagnosis, Magnitude, Standing

_GRADES = ("healthy", "changed", "fault", "none", "fault", "healthy")
_FAULTS = ("", "", "lubrication", "", "backlash", "")


def detection(count: int, dated: bool = False) -> Detection:
    """As many runs as are asked for, healthy and not."""
    actuator = ematwin.load_actuator("rm1605")
    baseline = SimpleNamespace(recordings=3)
    calibration: Any = SimpleNamespace(actuator=actuator, baseline=baseline)
    kind, rows = model_of(actuator), []
    for n in range(count):
        grade, fault = _GRADES[n % 6], _FAULTS[n % 6]
        magnitudes = tuple(
            Magnitude(one.name, one.unit, 1.0 + 0.1 * n, 0.9 + 0.1 * n, 1.1 + 0.1 * n, (0.8, 1.2),
                      float(n))
            for one in kind.monitoring.reported(kind, actuator)
        )  # fmt: skip
        faults: Any = (fault,) if fault else ()
        rows.append(
            Diagnosis(
                name=f"run {n + 1}", labels={"run": str(n + 1)}, magnitudes=magnitudes,
                verdict=Verdict(grade, faults, "Because <it> is so.", "Said because <it> is so."),
                alarm=bool(fault), when=f"2026-11-{n + 1:02d}T08:00:00" if dated else None,
                standing=Standing(1.0 + n),
            )
        )  # fmt: skip
    return Detection(tuple(rows), tuple(list(rows)), {"": calibration})
