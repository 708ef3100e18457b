"""Forms that the paper simplifies, in more detail: options of the parameter file.

A section such as ``[shorted_turns]`` in the file turns them on. They live in the reference model,
by which answers are corrected; the monitor model has only what such a correction does not reach,
the loops of shorted turns. The models of the paper's forms are left as they are: kernels are
compiled once without the steps in this folder and once with them, where a form that the file leaves
out has a neutral value.
"""
