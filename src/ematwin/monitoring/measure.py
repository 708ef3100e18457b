"""What is measured on each motion, before any verdict: magnitudes, residuals, features."""

from dataclasses import dataclass

import numpy as np

from ematwin.errors import RecordError
from ematwin.monitoring.coupling import coupling, decoupled_current
from ematwin.monitoring.estimate import estimate, first_prior, first_starts
from ematwin.monitoring.features import Layout
from ematwin.monitoring.nominal import FIRST_WEIGHTS
from ematwin.monitoring.population import load_basis
from ematwin.monitoring.twin import twin_traces
from ematwin.plant.ball_screw import BallScrew
from ematwin.signals.motion import Motion

# Magnitudes that are reported: name, unit, meaning.
REPORTED = {
    "friction": ("x", "dry friction, as a multiple of the healthy one"),
    "backlash": ("mm", "play of the nut on the screw"),
    "gain": ("x", "gain of the position loop, as a multiple of the healthy one"),
    "roughness": (
        "x",
        "roughness while moving, as a multiple of the healthy one: fast swings of current and "
        "position that the twin does not explain, from one turn of the screw upwards",
    ),
}
_ROUGH_BANDS = (3, 4, 5)  # of `ematwin.monitoring.features.BANDS`, counted from 1
_SAME_COMMAND = 0.02  # of the travel
_SAME_RATE = 0.01


@dataclass(frozen=True)
class Measured:
    """Measurements on N motions.

    Attributes
    ----------
    magnitudes : (N, 5) array, as in `ematwin.monitoring.twin.MAGNITUDES`
    current, position_error : (N, S) arrays, residuals after the twin, A and m
    coupling : (N,) array, A/m
    """

    magnitudes: np.ndarray
    current: np.ndarray
    position_error: np.ndarray
    coupling: np.ndarray

    @property
    def load(self) -> np.ndarray:
        """(N,) array, N."""
        return self.magnitudes[:, 3]


class Bench:
    """Motions over one command, prepared once and then measured with any actuator.

    Parameters
    ----------
    motions : all with the set point and the interval given
    set_point : (S,) array, m; ``interval`` in s
    layout : phases and features
    """

    def __init__(
        self, motions: list[Motion], set_point: np.ndarray, interval: float, layout: Layout
    ) -> None:
        check_alike(motions, set_point, interval)
        self.set_point, self.interval, self.layout = set_point, interval, layout
        calm = np.zeros(set_point.size, dtype=bool)
        for phase in layout.phases:
            if phase.steady:
                calm[phase.samples] = True
        self.coupling = np.array([coupling(m, calm) if calm.any() else 0.0 for m in motions])
        self.current = np.stack(
            [decoupled_current(m, s) for m, s in zip(motions, self.coupling, strict=True)]
        )
        self.position_error = np.stack([m.position_error for m in motions])

    def measure(
        self,
        actuator: BallScrew,
        discrepancy: np.ndarray | None = None,
        load_scale: float = 1.0,
        starts: np.ndarray | None = None,
    ) -> Measured:
        """Magnitudes of every motion and what the twin leaves unexplained.

        ``discrepancy`` (3, 2 S), over the load, is taken off first; it needs the loads, so that
        ``starts`` (N, 5), magnitudes found without it, must come with it.
        """
        prior = first_prior(actuator)
        count, samples = self.current.shape
        missed = np.zeros((count, 2 * samples))
        if discrepancy is not None and starts is not None:
            missed = load_basis(starts[:, 3], load_scale) @ discrepancy
        current = self.current - missed[:, :samples]
        error = self.position_error - missed[:, samples:]
        found = np.empty((count, prior.mean.size))
        for n in range(count):
            first = (
                first_starts(actuator, self.position_error[n, 0])
                if starts is None
                else starts[n][None]
            )
            found[n], _ = estimate(
                actuator, self.set_point, self.interval, current[n], error[n], FIRST_WEIGHTS,
                prior, first,
            )  # fmt: skip
        i, e = twin_traces(actuator, self.set_point, self.interval, found)
        if discrepancy is not None:
            missed = load_basis(found[:, 3], load_scale) @ discrepancy
        return Measured(
            found,
            self.current - i - missed[:, :samples],
            self.position_error - e - missed[:, samples:],
            self.coupling,
        )

    def features(self, measured: Measured) -> np.ndarray:
        """Features (N, F)."""
        return np.stack([
            self.layout.values(m, i, e)
            for m, i, e in zip(
                measured.magnitudes, measured.current, measured.position_error, strict=True
            )
        ])  # fmt: skip


def reported_values(layout: Layout, features: np.ndarray) -> np.ndarray:
    """Values (N, 4) of `REPORTED`: ratios as logarithms, backlash in m, roughness as a level."""
    names = layout.names
    moving = {phase.title for phase in layout.phases if phase.steady and phase.moving}
    rough = [
        n
        for n, name in enumerate(names)
        if any(
            name == f"{channel} band {band}, {title}"
            for channel in ("current", "error")
            for band in _ROUGH_BANDS
            for title in moving
        )
    ]
    roughness = features[:, rough].mean(1) if rough else np.zeros(len(features))
    return np.column_stack([
        np.log(features[:, names.index("friction")]),
        features[:, names.index("backlash")],
        np.log(features[:, names.index("gain")]),
        roughness,
    ])  # fmt: skip


def check_alike(motions: list[Motion], set_point: np.ndarray, interval: float) -> None:
    """Raise `RecordError` unless all motions follow one command at one rate."""
    travel = float(np.ptp(set_point))
    if travel <= 0.0:
        raise RecordError(
            f"The set point of {motions[0].name} never moves; a motion is needed that goes out "
            "and back."
        )
    for motion in motions:
        if abs(motion.interval - interval) > _SAME_RATE * interval:
            raise RecordError(
                f"{motion.name} is sampled each {motion.interval:g} s where {interval:g} s is "
                "needed; resample it, or calibrate for this rate."
            )
        if motion.set_point.size != set_point.size:
            raise RecordError(
                f"{motion.name} has {motion.set_point.size} samples where {set_point.size} are "
                "needed: it is another motion, or cut short. Leave it out, or calibrate for it."
            )
        off = float(np.abs(motion.set_point - set_point).max())
        if off > _SAME_COMMAND * travel:
            raise RecordError(
                f"{motion.name} follows another command: it is off by up to {off:.4g} m of "
                f"{travel:.4g} m of travel. Leave it out, calibrate for it, or correct its unit."
            )
        _check_signals(motion, set_point)


def _check_signals(motion: Motion, set_point: np.ndarray) -> None:
    mean = float(motion.current.mean())
    if mean < 0.0:
        raise RecordError(
            f"{motion.name}: its current is negative on the average ({mean:.3g} A), where the "
            "magnitude that the drive takes is needed; change its sign."
        )
    if np.ptp(motion.current) == 0.0:
        raise RecordError(
            f"{motion.name}: its current never changes from {mean:.3g} A; the channel is dead."
        )
    error = motion.position_error
    if float(np.abs(error).max()) > float(np.ptp(set_point)):
        raise RecordError(
            f"{motion.name}: its position error reaches {np.abs(error).max():.4g} m, more than the "
            "travel; its unit is probably wrong, or a position was taken for an error."
        )
    start = np.argmax(np.abs(np.diff(set_point)) > 0.0)
    first = slice(int(start), int(start) + max(8, error.size // 16))
    ahead = -float(error[first].mean() * np.sign(set_point[first][-1] - set_point[first][0]))
    if ahead > 0.3 * float(np.abs(error).max()):
        raise RecordError(
            f"{motion.name}: the nut runs ahead of its set point by {ahead:.3g} m when it starts: "
            "the position error has the wrong sign (set point less position is needed). Change it."
        )
