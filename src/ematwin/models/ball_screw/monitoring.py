"""How healthy ball screws are judged: reported quantities, roughness, shared noise of sensors."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ematwin.models.base import Monitoring, Reported, Statistic
from ematwin.models.comparison import Comparison
from ematwin.recordings.recording import Recording

_SETTLED = 6.3  # time constants of the position loop until a transient has died out
_ROUGH_BANDS = (3, 4, 5)  # of the residual's spectrum: one turn of the screw, harmonics, balls


class BallScrewMonitoring(Monitoring):
    """Features depend on the load; the coupling of the sensors is measured beside them."""

    def reported(self, model: Any, actuator: Any) -> tuple[Reported, ...]:
        """Magnitudes as multiples of healthy ones, backlash in mm, and roughness."""
        return (
            Reported("friction", "x", "dry friction, as a multiple of the healthy one",
                     True, named="lubrication", least=0.25),
            Reported("backlash", "mm", "play of the nut on the screw",
                     scale=1e3, named="backlash", least=5e-4),
            Reported("gain", "x", "gain of the position loop, as a multiple of the healthy one",
                     True, least=0.25),
            Reported("roughness", "x", "roughness while moving, as a multiple of the healthy one: "
                     "fast swings of current and position that the twin does not explain, from one "
                     "turn of the screw upwards", True, named="spalling"),
        )  # fmt: skip

    def settling_time(self, actuator: Any) -> float:
        """Seconds until a transient of the position loop has died out."""
        return float(_SETTLED / actuator.controller.position_gain)

    def compare(
        self, model: Any, recording: Recording, actuator: Any, settling_time: float
    ) -> Comparison:
        """With the coupling of the sensors in steady motion, as the calibration defines it."""
        compared: Comparison = model.compare(recording, actuator, settling_time=settling_time)
        return compared

    def derived(self, features: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Roughness: the mean level of the fast bands of both residuals in steady motion."""
        rough = [
            values
            for name, values in features.items()
            if name.endswith(", steady")
            and " rest" not in name
            and any(f" band {band}, " in name for band in _ROUGH_BANDS)
        ]
        some = next(iter(features.values()))
        return {"roughness": np.column_stack(rough).mean(1) if rough else np.zeros_like(some)}


MONITORING = BallScrewMonitoring(
    covariate="load",
    statistics=(
        Statistic(
            "sensor_coupling", "A/m", "The sensors share fast noise differently than in the "
            "healthy runs", "Rewiring or reassembly can cause this, and so can rough running. The "
            "noise is removed from the current before the verdict.",
        ),
    ),
    short={"position_error": "error"},
)  # fmt: skip
