"""The parameters of an actuator as the kernels take them: reflected to the motor shaft."""

from ematwin.kernels.state import Constants
from ematwin.plant.parameters import Actuator


def kernel_constants(actuator: Actuator) -> Constants:
    """Constants of the equations in docs/models.md, SI, phase values, on the motor shaft."""
    motor, drive, control = actuator.motor, actuator.drive, actuator.controller
    gear = actuator.transmission
    return Constants(
        resistance=motor.resistance / 2.0,
        inductance=motor.inductance / 2.0,
        leakage=motor.leakage_share,
        k_e=motor.emf_constant / 2.0,
        pole_pairs=float(motor.pole_pairs),
        v_supply=drive.supply_voltage,
        v_diode=drive.diode_drop,
        half_band=drive.hysteresis_band / 2.0,
        i_max=drive.current_limit,
        w_max=control.speed_limit,
        k_position=control.position_gain,
        k_speed=control.speed_gain,
        j_m=motor.inertia,
        j_o=gear.output_inertia,
        viscous=motor.viscous_damping,
        t_m=motor.friction_torque,
        t_o=gear.friction_torque,
        static_ratio=gear.static_ratio,
        c_opposing=1.0 / gear.efficiency_opposing - 1.0,
        c_aiding=1.0 - gear.efficiency_aiding,
        half_gap=gear.backlash / 2.0,
        contact_stiffness=gear.contact_stiffness,
        contact_damping=gear.contact_damping,
        travel_low=gear.travel_low * gear.ratio,
        travel_high=gear.travel_high * gear.ratio,
    )
