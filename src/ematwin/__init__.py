"""Find the faults of an electromechanical actuator from a recording of how it moved."""

__version__ = "0.1.0"
