"""Cascaded controller: position, speed, current reference.

docs/models.md: position error on the output -> proportional gain (drifts with the gain fault) ->
speed reference, limited -> proportional speed loop -> current reference, limited. All on the motor
shaft, in SI units.
"""

from ematwin.numerics.compile import step
from ematwin.numerics.scalar import clip


@step
def current_demand(command, theta_o, w_m, k_position, k_demand, w_max):
    """Current that the speed loop asks for, A, before its limit; as in `current_reference`.

    ``k_demand`` is ``k_speed`` over ``k_torque``, A s/rad.
    """
    w_ref = clip(k_position * (command - theta_o), -w_max, w_max)
    return k_demand * (w_ref - w_m)


@step
def current_reference(command, theta_o, w_m, k_position, k_speed, w_max, k_torque, i_max):
    """Current reference of the drive, A.

    ``command`` and ``theta_o`` are output positions on the motor shaft, rad; ``k_torque`` is the
    healthy torque constant by which the drive turns its torque demand into a current.
    """
    demand = current_demand(command, theta_o, w_m, k_position, k_speed / k_torque, w_max)
    return clip(demand, -i_max, i_max)
