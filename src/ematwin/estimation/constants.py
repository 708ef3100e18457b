"""The numbers by which answers are judged: one table, which docs/inference.md shows.

Steps, iterations and batches are not among them: they change how long an answer takes, and stand
where they are used.
"""

# stated probabilities
LEVEL, COVERAGE = 0.95, 1.96  # of intervals, and standard deviations to both sides
CERTAIN = 0.95  # probability from which a fault is named
SIGMAS = 3.0  # standard errors from which a value stands out: by chance once in 740 cases
APART = 0.05  # share of a range by which two explanations differ
DECIDES = SIGMAS**2  # squared standard deviations by which another form beats that of the file
WORTH = 4.0  # the same by which a step of a descent has to gain: two standard deviations
IMPLAUSIBLE = 4.0  # standard deviations of a prior: once in 16,000 cases
FALSE_ALARM_RATE = 0.05  # of healthy recordings that may be called faulty
BEFOREHAND = 0.5  # probability of a fault before the recording is seen
TWO_SIGMA = 2.0  # standard deviations in a tolerance: a data sheet's 95 %
SEARCHED = 3.0  # standard deviations of a prior, to both sides, that a search looks at

# what matters to a user, as shares of a range
SMALLEST = 0.02  # less is no fault, however certain
TELLING = 0.15  # so large a fault is excluded where a verdict says healthy
ANYTHING = 0.25  # standard error from which a value may be anything; 0.29 where all is as likely

# relative misfits, and ratios of them; tuned on the recordings of docs/trust.md where marked so
EXPLAINED = 0.015  # a good fit of a twin without a reference; tuned
UNCALIBRATED = 0.03  # the most for a verdict without healthy recordings; tuned
WORST = 0.1  # the most for a verdict in any case; tuned
HOPELESS = 0.5  # explains nothing; a twin at rest leaves 1
AS_GOOD = 1.3  # times what noise, or healthy recordings, leave: as good as can be; tuned
WORSE = 2.0  # times the same: something is missing, and there is no verdict

# of calibrations, reports of trade-offs, and commands
DETERMINED = 0.5  # of the width that a parameter had before: the recordings determine it
SAME_COMMAND = 0.02  # of the travel
TRADED = 3.0  # times the error with all else known, from which others are named
PARTNERS = 2  # of those named at most
