"""Formats of recorded files, one a file."""
