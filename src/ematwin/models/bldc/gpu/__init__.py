"""The monitor model on a GPU, by numba-cuda."""
