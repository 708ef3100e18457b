"""Twins outside Python: an actuator as a Functional Mock-up Unit (FMI 3.0 and 2.0)."""
