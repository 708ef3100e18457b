"""Condition monitoring: calibrate a twin on healthy recordings, then judge others against them."""
