"""Forms that the paper simplifies, in more detail: options of the parameter file.

A section such as ``[shorted_turns]`` in the file turns them on. They are in the reference model, by
which answers are corrected, where a form that the file leaves out has a neutral value. The monitor
model has only what such a correction does not reach, the loops of shorted turns.
"""

REFERENCE_ALONE = (
    "emf.", "torque_ripple.", "cogging.", "presliding.", "winding_heat.", "supply.", "speed_loop.",
    "current_loop.", "compliance.", "encoder.",
)  # fmt: skip
"""Sections of forms that the reference model alone has (docs/models.md, "Truer forms")."""
