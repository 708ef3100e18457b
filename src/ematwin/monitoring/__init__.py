"""Condition monitoring: calibrate a twin on healthy motions, then judge others against them."""
