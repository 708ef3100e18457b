"""The brushless actuator: six-step drive, reference and monitor model, faults of the paper."""
