"""Contract suites that third parties can run on their own parts.

Nothing here needs pytest: a suite is a list of functions that raise AssertionError.
"""
