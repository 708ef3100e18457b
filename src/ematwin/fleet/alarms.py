"""Alarms: watch, plan, act, from the posteriors of trend and life, with the reason.

- watch: a magnitude is larger than matters (`SMALLEST` of its range) with a probability of
  1 - rate/M, for M magnitudes, by the recordings so far: that none came for long is no reason for
  an alarm. Of alarms raised at that moment a share rate/M is false whenever one
  looks: a posterior does not depend on when one stops. An alarm that has cleared is not raised
  again within a year, so that there are at most ``rate`` false ones per actuator and year.
- plan, act: besides, its limit is passed within a planning or a lead time after the next look, as
  nobody acts before, with a probability of 10 %: the lower end of the 80 % interval of life left.

An alarm falls back a step where its probability is below half of the value that raised it. It
clears where the magnitude is more likely too small to matter (hysteresis).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from scipy.stats import norm

from ematwin.errors import InputError
from ematwin.estimation.constants import SMALLEST
from ematwin.fleet.life import LEVEL, Life, spoken
from ematwin.fleet.trend import Trend

Step = Literal["none", "watch", "plan", "act"]
STEPS: tuple[Step, ...] = ("none", "watch", "plan", "act")
_AGAIN = 1.0  # years after an alarm has cleared in which it is not raised again


@dataclass(frozen=True)
class Policy:
    """When alarms are raised."""

    false_alarms: float = 0.1  # per actuator and year, at most
    # plan, act: years before its limit by which a magnitude asks for a plan, or for action
    plan: float = 0.5
    act: float = 1.0 / 12.0
    look: float = 0.0  # years between two looks at the alarms

    def __post_init__(self) -> None:
        if not 0.0 < self.false_alarms < 1.0:
            raise InputError(
                "false_alarms must lie between 0 and 1 per actuator and year, received "
                f"{self.false_alarms:g}."
            )
        if not 0.0 < self.act <= self.plan or not self.look >= 0.0:
            raise InputError(
                "act, plan and look must be times with 0 < act <= plan and 0 <= look, received "
                f"{self.act:g}, {self.plan:g} and {self.look:g} years."
            )


@dataclass(frozen=True)
class Alarm:
    """An alarm on one magnitude of an actuator."""

    magnitude: str
    step: Step
    probability: float  # that the magnitude is larger than matters
    ends: float  # years, the lower end of the life until its limit; infinite where none is stated
    why: str  # a sentence, and what to check
    since: float = math.nan  # years, when this step was reached
    acknowledged: bool = False  # somebody has seen it
    silenced: bool = False  # somebody wants to hear no more of it for now

    @property
    def urgency(self) -> int:
        """0 for none to 3 for act; silenced ones are none."""
        return 0 if self.silenced else STEPS.index(self.step)


class Before(NamedTuple):
    """The step of an alarm when it was last looked at, since when, and when it last cleared."""

    step: Step
    since: float
    cleared: float = -math.inf


def exceeding(one: Trend, unknown: Any) -> float:
    """Probability that a magnitude was further from healthy than matters when last recorded."""
    level, error, _ = one.at(one.time)
    least = SMALLEST * unknown.width
    beyond = float(norm.sf(unknown.healthy + least, level, error))
    if unknown.lower < unknown.healthy:  # it may be off to both sides, such as a gain
        beyond += float(norm.cdf(unknown.healthy - least, level, error))
    return beyond


def judge(
    one: Trend, life: Life | None, moment: float, policy: Policy, *, unknown: Any, count: int,
    before: Before | None = None,
) -> Alarm:  # fmt: skip
    """The alarm of one magnitude (``unknown``) of ``count`` at a moment, years.

    ``life`` lasts until its limit, None where none is stated; ``before`` is the step it had.
    """
    probability, held = exceeding(one, unknown), before or Before("none", moment)
    certain = 1.0 - policy.false_alarms / count
    present = probability >= certain or (held.step != "none" and probability >= 0.5)
    if held.step == "none" and moment - held.cleared < _AGAIN and (
        life is None or life.within(policy.look + policy.act) < 0.5
    ):  # fmt: skip
        present = False
    step: Step = "watch" if present else "none"
    limit = ""
    if present and life is not None:
        for name, time in (("act", policy.act), ("plan", policy.plan)):
            ahead = policy.look + time
            soon = life.within(ahead)
            kept = STEPS.index(held.step) >= STEPS.index(name)
            enough = 0.5 - LEVEL / 2.0  # the lower end of the interval of life left
            if soon >= (0.5 * enough if kept else enough):
                step = name  # type: ignore[assignment]
                near = f"passes its limit within {spoken(ahead)} (probability {100 * soon:.0f} %)"
                limit = "; it " + ("is beyond its limit" if life.interval[1] == 0.0 else near)
                break
    since = held.since if step == held.step else moment
    why = _why(one, moment, unknown, step, limit)
    ends = math.inf if life is None else life.interval[0]
    return Alarm(unknown.name, step, probability, ends, why, since)


def _why(one: Trend, moment: float, unknown: Any, step: Step, limit: str) -> str:
    """One sentence on the magnitude, its slope and its limit; what to check where alarmed."""
    level, error, slope = one.at(one.time)
    share, spread = (level - unknown.healthy) / unknown.width, error / unknown.width
    jumped = [at for at in one.series.time[list(one.jumps)] if one.time - at < _AGAIN]
    sudden = jumped and not any(at > jumped[-1] for at in one.series.overhauls)
    said = f"{unknown.name.replace('_', ' ')} is {100 * share:+.1f} % of its range from healthy"
    said += f" (standard error {100 * spread:.1g} %)"
    if sudden:
        said += f" after a jump {spoken(moment - float(jumped[-1]))} ago"
    elif step != "none":
        said += f" and changes by {100 * slope / unknown.width:+.1f} % a year"
    check = f" Check: {unknown.meaning.partition(',')[0]}." if step != "none" else ""
    return f"{said}{limit}.{check}"


def by_urgency(alarms: Mapping[str, Alarm]) -> list[Alarm]:
    """The alarms of an actuator, the most urgent first; of two, what ends its life sooner."""
    return sorted(alarms.values(), key=lambda one: (-one.urgency, one.ends, -one.probability))
