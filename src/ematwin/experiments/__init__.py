"""Experiments before they are made: which faults a test command can determine."""
