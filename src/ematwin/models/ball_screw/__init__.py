"""The ball-screw actuator: stepper motor, screw, sampled position loop."""
