"""Speed and memory, measured as ratios and medians; run by ``ematwin bench``, never by a test."""
