"""Identification: the faults with which the twin answers as the recorded actuator did."""
