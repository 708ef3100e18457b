"""A PMSM servo under field-oriented control, with a gear: docs/pmsm.md."""
