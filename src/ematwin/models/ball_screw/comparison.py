"""A recording of a ball-screw actuator beside its twin: current and position error together."""

from typing import Any

from ematwin.models.ball_screw.coupling import coupling, decoupled
from ematwin.models.ball_screw.plausibility import position_error
from ematwin.models.comparison import TraceComparison
from ematwin.models.phases import calm
from ematwin.recordings.recording import Recording


class BallScrewComparison(TraceComparison):
    """Residuals of current and position error, each weighed by its noise.

    The fast noise that the two sensors share is measured where the motion is steady
    (``statistics["sensor_coupling"]``, A/m) and taken out of the current.

    Parameters
    ----------
    model, recording, actuator : as in `TraceComparison`
    settling_time : s, from a change of the commanded speed to steady motion
    """

    def __init__(
        self, model: Any, recording: Recording, actuator: Any, *, settling_time: float
    ) -> None:
        error = position_error(recording)
        steady = calm(recording.set_point, recording.interval, settling_time)
        share = coupling(recording.current, error, steady) if steady.any() else 0.0
        current = decoupled(recording.current, error, share)
        super().__init__(model, recording, actuator, {"current": current, "position_error": error})
        self.statistics = {"sensor_coupling": share}
