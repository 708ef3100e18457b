"""Analysis of a study: errors, performance coefficient, rank tests, convergence, diagnosis."""
