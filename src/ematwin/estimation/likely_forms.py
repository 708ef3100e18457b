"""A form that shows only in how likely it makes the motion of healthy recordings.

The likelihood (`Model.likelihood`) is rough in the values of such a form: they are chosen from a
list. Whether the actuator has it is judged by recordings in turn: values that suit the others have
to make most of them likelier, and all of them together. Where a motor breaks loose late in a long
recording is a matter of chance, and may count for more than all else.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ematwin.estimation.constants import DECIDES
from ematwin.estimation.equations import candidate
from ematwin.estimation.forms import Explained, FoundForms
from ematwin.models.base import Model
from ematwin.models.optional import Likelihood
from ematwin.models.parameter_set import ParameterSet
from ematwin.recordings.recording import Recording


def with_likely_form(
    model: Model, template: ParameterSet, recordings: Sequence[Recording], known: FoundForms
) -> FoundForms:
    """Add the form that the likelihood of the motion shows, with its values, to forms found."""
    # values of several equations may make a loop unstable together
    actuator, _ = candidate(known.actuator, known.values) or (known.actuator, {})
    seen = [model.likelihood(one, actuator) for one in recordings]
    each = [one for one in seen if one is not None]
    if not each or each[0].form.is_stated(template):
        return known
    form = each[0].form
    own = {place: known.actuator.value(place) for place in form.places if form.is_stated(actuator)}
    tried = (candidate(actuator, {**values, **own}) for values in form.starts(actuator))
    starts = list(dict.fromkeys(one[0] for one in tried if one is not None))
    gains = _gains(each, actuator, starts)
    other = _best(actuator, starts, gains)
    if not own and (other is actuator or not _is_shown(gains)):
        return replace(known, absent=tuple(dict.fromkeys((*known.absent, form.name))))
    if not own:  # else equations have found it, and not all of its values
        samples = sum(one.samples for one in each)
        share = -math.expm1(-2.0 * float(gains[starts.index(other)].sum()) / samples)
        known = replace(
            known,
            found=(*known.found, form.said(other)),
            explained=(*known.explained, Explained("motion", 1, share)),
            absent=tuple(name for name in known.absent if name != form.name),
        )
    sections = {place.partition(".")[0] for place in form.places}
    values = {
        place: value
        for place, value, *_ in other.parameters()
        if place.partition(".")[0] in sections and place not in own
    }
    return replace(
        known, actuator=known.actuator.changed(values), values={**known.values, **values}
    )


def _gains(
    each: Sequence[Likelihood], actuator: ParameterSet, others: Sequence[ParameterSet]
) -> np.ndarray:
    """(A, R), by how much others make each recording likelier, in the logarithm."""
    every = np.array([one.log_densities([actuator, *others]) for one in each]).T
    return np.asarray(every[1:] - every[0])


def _is_shown(gains: np.ndarray) -> bool:
    """Whether starts with gains (A, R) that suit the others make recordings likelier."""
    if gains.shape[1] < 2:
        return False
    rest = (np.delete(gains, n, axis=1) for n in range(gains.shape[1]))
    held_out = gains[[_row(one) for one in rest], np.arange(gains.shape[1])]
    return bool(held_out.sum() > DECIDES) and _for_it(held_out)


def _for_it(gains: np.ndarray) -> Any:
    """Whether most of the recordings (..., R) are likelier."""
    return np.mean(gains > 0.0, axis=-1) > 0.5


def _row(gains: np.ndarray) -> int:
    """Which row of gains (A, R) is the largest of those that most recordings speak for."""
    return int(np.lexsort((gains.sum(axis=1), _for_it(gains)))[-1])


def _best(
    actuator: ParameterSet, others: Sequence[ParameterSet], gains: np.ndarray
) -> ParameterSet:
    """The best of others by their gains (A, R), or the actuator itself where none is better."""
    if len(gains) == 0:
        return actuator
    row = _row(gains)
    return others[row] if gains[row].sum() > 0.0 and _for_it(gains[row]) else actuator
