"""What the paper reports of its own study: ESREL 2020, section 7.

Table 2 (section 7.2, "Single Fault Analysis"): performance coefficient in per cent, by case and
algorithm, as printed. Table 1 are the cases of the kind `PAPER_KIND`. The bars of figures 4 to 7
carry no numbers, so none of them are here; what the text says of them is in
`ematwin.comparison.analysis.claims`.
"""

import numpy as np

from ematwin.comparison.study.cases import PAPER_KIND as PAPER_KIND
from ematwin.optimizers.presets import PRESETS

# in the order of the columns of Table 2
PAPER_ALGORITHMS = ("ga", "pso", "de", "gwo", "da", "woa")

TABLE_2 = {
    "Low F": (74, 87, 90, 87, 89, 74),
    "High F": (77, 85, 88, 90, 86, 73),
    "Low B": (80, 87, 91, 90, 87, 66),
    "High B": (81, 84, 88, 88, 83, 76),
    "Low Na": (88, 97, 98, 96, 87, 33),
    "High Na": (67, 89, 92, 91, 89, 72),
    "Low Z": (97, 93, 99, 98, 69, 43),
    "High Z": (97, 98, 98, 94, 96, 17),
    "Low Gain": (51, 90, 92, 93, 90, 85),
    "High Gain": (47, 95, 93, 93, 78, 94),
}
TABLE_2_AVERAGE = (76, 91, 93, 92, 85, 63)

# The cases of figures 4 and 6, and of figures 5 and 7. The paper calls 0.30 and 0.25 low.
LOW_CASES = ("Low F", "Low B", "Low Na", "Low Z", "Low Gain")
HIGH_CASES = ("High F", "High B", "High Na", "High Z", "High Gain")


def standing_for(algorithms: list[str]) -> dict[str, str]:
    """Which method of a study stands for each of the paper's six, in the order of Table 2.

    The form as first published where the study has it, else this package's own form, which goes by
    the paper's name; none where the study has neither.
    """
    published = dict(zip(PAPER_ALGORITHMS, PRESETS["paper"], strict=True))
    found = {}
    for name in PAPER_ALGORITHMS:
        for form in (published[name], name):
            if form in algorithms:
                found[name] = form
                break
    return found


def paper_coefficients(
    cases: list[str], algorithms: list[str], kind: str = PAPER_KIND
) -> np.ndarray:
    """Table 2 for these cases and algorithms on a kind of actuator.

    Returns
    -------
    (C, A) array, per cent, NaN where the paper has no number
    """
    table = np.full((len(cases), len(algorithms)), np.nan)
    for c, case in enumerate(cases):
        for a, algorithm in enumerate(algorithms):
            if kind == PAPER_KIND and case in TABLE_2 and algorithm in PAPER_ALGORITHMS:
                table[c, a] = TABLE_2[case][PAPER_ALGORITHMS.index(algorithm)]
    return table
