"""Brushed DC motor with a gearbox in a position servo: a kind of actuator for ematwin."""
