"""Scores: how far recordings lie from health, feature by feature, and what follows from that."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ematwin.errors import InputError
from ematwin.monitoring.index import health_index, prediction_bound

FALSE_ALARM_RATE = 0.1


@dataclass(frozen=True)
class Scores:
    """Features of N recordings in healthy standard deviations from the healthy mean.

    Attributes
    ----------
    values : (N, F) array
    names : of the features
    kinds : "model", "mean" or "band", one for each feature
    groups : (N,) array, number of the run (and condition) of each recording
    """

    values: np.ndarray
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    groups: np.ndarray

    def index(self, kinds: Collection[str] | None = None) -> np.ndarray:
        """Health index (N,); of the features of some kinds where these are given.

        Raises
        ------
        InputError
            If there is no feature of these kinds.
        """
        if kinds is None:
            return health_index(self.values, self.kinds)
        columns = [n for n, kind in enumerate(self.kinds) if kind in kinds]
        if not columns:
            raise InputError(
                f"There are no features of the kinds {', '.join(kinds) or 'none'}; there are "
                f"{', '.join(dict.fromkeys(self.kinds))}."
            )
        return health_index(self.values[:, columns], [self.kinds[n] for n in columns])

    def limit(
        self, false_alarm_rate: float = FALSE_ALARM_RATE, kinds: Collection[str] | None = None
    ) -> float:
        """The index that a recording of another healthy run exceeds at this rate.

        These scores must be of healthy recordings that the calibration did not learn from.
        """
        return prediction_bound(self.index(kinds), self.groups, false_alarm_rate)
