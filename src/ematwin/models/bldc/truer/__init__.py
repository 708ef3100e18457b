"""Truer forms of what the paper simplifies: options of the parameter file, in both models.

A section such as ``[shorted_turns]`` in the file turns them on. The models of the paper's forms
are left as they are: kernels are compiled once without the steps in this folder and once with them
all, where a form that the file leaves out has a neutral value.
"""
