"""Two masses with dry friction and a rigid gap between stops, as an automaton with exact events.

Between events the motion is smooth and scipy integrates it to its own tolerance; the events
(a mass stops, breaks loose, meets the other, leaves it) are found by root search. Nothing here
knows of steps, so it shows what the fixed steps of the kernels converge to.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Mass:
    """Inertia (kg m^2), static and dynamic friction (N m)."""

    inertia: float
    static: float
    dynamic: float


@dataclass(frozen=True)
class Mode:
    """Which face touches (1: motor ahead, -1: output ahead, 0: none), and who moves which way."""

    face: int
    motor_way: int
    output_way: int


def way_of(x):
    """Sign of a speed or torque, as the direction of a motion."""
    return int(np.sign(x))


class TwoMasses:
    """Motor and output with a gap of ``2 half_gap``; torques are functions of time and state.

    The state is ``x_m, w_m, x_o, w_o``.
    """

    def __init__(self, motor, output, half_gap, motor_torque, output_torque):
        self.motor, self.output, self.half_gap = motor, output, half_gap
        self.motor_torque, self.output_torque = motor_torque, output_torque

    def accelerations(self, t, y, mode):
        act_m, act_o = self.motor_torque(t, y), self.output_torque(t, y)
        drag_m = mode.motor_way * self.motor.dynamic
        drag_o = mode.output_way * self.output.dynamic
        if mode.face == 0:
            a_m = (act_m - drag_m) / self.motor.inertia if mode.motor_way else 0.0
            a_o = (act_o - drag_o) / self.output.inertia if mode.output_way else 0.0
            return a_m, a_o
        if mode.motor_way == 0:
            return 0.0, 0.0
        total = self.motor.inertia + self.output.inertia
        a = (act_m + act_o - drag_m - drag_o) / total
        return a, a

    def slope(self, t, y, mode):
        a_m, a_o = self.accelerations(t, y, mode)
        return [y[1], a_m, y[3], a_o]

    def events(self, mode):
        """Pairs of a function that falls through zero and the mode it leads to."""
        found = []
        if mode.face == 0:
            bodies = (("motor", self.motor, self.motor_torque, 1, mode.motor_way),
                      ("output", self.output, self.output_torque, 3, mode.output_way))  # fmt: skip
            for name, body, torque, at, way in bodies:
                if way:
                    found.append((lambda t, y, at=at, way=way: way * y[at], f"{name} stops"))
                else:
                    found.append(
                        (lambda t, y, body=body, torque=torque: body.static - abs(torque(t, y)),
                         f"{name} breaks loose")
                    )  # fmt: skip
            found.append((lambda t, y: self.half_gap - abs(y[0] - y[2]), "meet"))
            return found
        if mode.motor_way:
            return [
                (lambda t, y: mode.motor_way * y[1], "both stop"),
                (lambda t, y: self.pressure(t, y, mode), "part"),
            ]
        return [
            (lambda t, y: self.motor.static + mode.face * self.motor_torque(t, y), "motor leaves"),
            (lambda t, y: self.output.static - mode.face * self.output_torque(t, y),
             "output leaves"),
            (self.hold, "both break loose"),
        ]  # fmt: skip

    def pressure(self, t, y, mode):
        """Torque on the touching face, positive while it pushes."""
        a, _ = self.accelerations(t, y, mode)
        friction = mode.output_way * self.output.dynamic
        return mode.face * (self.output.inertia * a - self.output_torque(t, y) + friction)

    def hold(self, t, y):
        """What is left of static friction when both rest against each other."""
        total = self.motor_torque(t, y) + self.output_torque(t, y)
        return self.motor.static + self.output.static - abs(total)

    def settle(self, t, y, mode):
        """The mode that follows at this instant, and the state."""
        y = list(y)
        act_m, act_o = self.motor_torque(t, y), self.output_torque(t, y)

        def way(body, torque, speed):
            loose = torque if abs(torque) >= body.static else 0.0
            return way_of(speed if speed != 0.0 else loose)

        apart = Mode(0, way(self.motor, act_m, y[1]), way(self.output, act_o, y[3]))
        if mode.face == 0:
            return apart, y
        if y[1] != 0.0:
            together = Mode(mode.face, way_of(y[1]), way_of(y[1]))
            pulls = self.pressure(t, y, together) < 0.0
            return (replace(together, face=0) if pulls else together), y
        if apart.motor_way * mode.face < 0 or apart.output_way * mode.face > 0:
            return apart, y  # one of them leaves
        both = way_of(act_m + act_o) if self.hold(t, y) <= 0.0 else 0
        return Mode(mode.face, both, both), y

    def run(self, y, times):
        """States (T, 4) at ``times``, and the events as ``(time, what)``."""
        mode, y = self.settle(times[0], y, Mode(0, 0, 0))
        now, states, log = times[0], np.empty((len(times), 4)), []
        states[0] = y
        filled = 1
        while filled < len(times):
            events = []
            kinds = self.events(mode)
            for function, _ in kinds:
                event = lambda t, y, function=function: function(t, y)  # noqa: E731
                event.terminal, event.direction = True, -1
                events.append(event)
            wanted = times[filled:]
            done = solve_ivp(
                lambda t, y, mode=mode: self.slope(t, y, mode), (now, times[-1]), y,
                events=events, rtol=1e-9, atol=1e-12, max_step=1e-4, dense_output=True,
            )  # fmt: skip
            end = done.t[-1]
            inside = wanted <= end
            if inside.any():
                states[filled : filled + inside.sum()] = done.sol(wanted[inside]).T
                filled += int(inside.sum())
            now, y = end, done.y[:, -1]
            if done.status != 1:
                break
            what = next(kinds[n][1] for n, hits in enumerate(done.t_events) if len(hits))
            log.append((now, what))
            assert len(log) < 500, f"events pile up: {log[-5:]}"
            mode, y = self.after(what, now, y, mode)
        return states, log

    def after(self, what, t, y, mode):
        """The mode that an event leads to, and the state."""
        y = list(y)
        act_m, act_o = self.motor_torque(t, y), self.output_torque(t, y)
        if what in ("motor stops", "both stop"):
            y[1] = 0.0
        if what in ("output stops", "both stop"):
            y[3] = 0.0
        if what == "meet":
            total = self.motor.inertia + self.output.inertia
            y[1] = y[3] = (self.motor.inertia * y[1] + self.output.inertia * y[3]) / total
            mode = Mode(1 if y[0] > y[2] else -1, 0, 0)
        if what == "part":
            return Mode(0, mode.motor_way, mode.output_way), y
        if what in ("motor breaks loose", "motor leaves"):
            return Mode(0, way_of(act_m), mode.output_way), y
        if what in ("output breaks loose", "output leaves"):
            return Mode(0, mode.motor_way, way_of(act_o)), y
        if what == "both break loose":
            return Mode(mode.face, way_of(act_m + act_o), way_of(act_m + act_o)), y
        return self.settle(t, y, mode)
