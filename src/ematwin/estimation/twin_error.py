"""How much larger errors are than the noise that a fit shows, for what the twin gets wrong.

What a twin gets wrong pulls the same way throughout a recording: standard errors are
`Model.model_error` times those of independent residuals. That factor is measured where the twin
leaves hardly more than the noise. Where it leaves more, it lacks something of the actuator. Some of
that is taken up by parameters and faults and does not show in what is left, so the factor grows up
to `Model.lacking_error`:

    f^2 = e^2 (1 - s) + l^2 s,    s = 1 - (m_0 / m)^2,

with m the relative misfit and m_0 that of noise and of the twin's usual error.
"""

import math

from ematwin.estimation.problem import Problem
from ematwin.models.base import Model


def twin_error(model: Model, problem: Problem, cost: float) -> float:
    """Factor on standard errors of a fit of the data that leaves this cost."""
    usual, most = model.model_error, model.lacking_error
    misfit = problem.relative_misfit(cost)
    if most is None or not misfit > problem.recorded_misfit:
        return usual
    share = 1.0 - (problem.recorded_misfit / misfit) ** 2
    return math.sqrt((1.0 - share) * usual**2 + share * most**2)
