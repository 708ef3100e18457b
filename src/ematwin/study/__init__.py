"""Studies: many identification runs, planned, run, stored, resumed."""
