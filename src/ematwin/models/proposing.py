"""`propose_map`: which channel of a bench's file is which, for a kind of actuator, with reasons.

Two channels that are equally likely become a question, and so does a unit that nobody states. Such
a unit is tried in each of the usual ones. One is ruled out if the numbers would be of a size that
no actuator has, or if the kind's own check of the recording refuses it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice, product
from typing import Any

import numpy as np

from ematwin.errors import EmatwinError, RecordError
from ematwin.models.base import Model
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.channel import Channel, with_time
from ematwin.recordings.proposal import Draft, Entry, Proposal, Question, values
from ematwin.recordings.read import read_file
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey, Surveyed, survey
from ematwin.recordings.words import unit_factor

_MOST_TRIES = 96  # combinations of units
# Units met on test benches, the likeliest first, and sizes that benches of such actuators meet,
# SI: of the sampling interval for time, of the largest magnitude else. Wide, so that they rule
# out only what is absurd.
_USUAL = {
    "s": (("s", "ms", "us"), (1e-6, 0.05)),
    "A": (("A", "mA"), (0.02, 2e3)),
    "V": (("V", "mV"), (0.1, 2e3)),
    "rad": (("rad", "deg"), (2e-3, 1e5)),
    "rad/s": (("rad/s", "rpm", "deg/s"), (0.02, 1e4)),
    "m": (("m", "mm", "um"), (2e-5, 10.0)),
    "N*m": (("N*m", "mN*m"), (0.02, 1e5)),
    "m/s": (("m/s", "mm/s"), (1e-5, 20.0)),
}


def propose_map(path: Any, actuator: Any = None, found: Survey | None = None) -> Proposal:
    """Propose a channel map for a file of a test bench.

    Names are compared with words that benches use, units with units of the channels. An unstated
    unit is taken where only one is plausible. What remains open is asked, and never
    chosen silently.

    Parameters
    ----------
    path : a file that `ematwin.read` knows, or a DataFrame
    actuator : parameters of any kind, the name of a shipped set, or a TOML file; its limits
        decide on plausibility; the default brushless actuator if not given
    found : what `ematwin.recordings.survey.survey` gave for the file, where it is there already

    Returns
    -------
    Proposal; ``Proposal.columns()`` is a map for `ematwin.read`

    Raises
    ------
    FileError
        If the file cannot be read.
    MissingExtraError
        If the library for this format is not installed.
    """
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    found = survey(path) if found is None else found
    draft = Draft(found, model.channels, model.required, model.command)
    recording, why = _read(path, model, draft.entries)
    _find_units(draft, model, recording, chosen)
    taken = {entry.channel for entry in draft.entries.values()}
    time, interval = draft.entries.get("time"), 0.0
    if time is not None and not time.is_open:
        interval = _size(draft.found[time.channel], draft.channels["time"])
        interval *= unit_factor(time.unit, "s", time.channel)
    proposal = Proposal(
        model.kind, draft.entries, tuple(draft.questions),
        unused=tuple(one.name for one in found.channels if one.name not in taken),
        rate=1.0 / interval if interval > 0.0 else None,  # NaN where no time is known
    )  # fmt: skip
    if any(one.needed for one in proposal.questions):
        return proposal
    if any(entry.unit_from == "plausibility" for entry in proposal.entries.values()):
        recording, why = _read(path, model, proposal.entries)
    if recording is not None:
        try:
            doubts = [*recording.provenance.get("warnings", []), *model.check(recording, chosen)]
            return replace(proposal, check=tuple(doubts))
        except EmatwinError as error:
            why = str(error)
    return replace(proposal, check=(why,), refused=True)


def _read(path: Any, model: Model, entries: Mapping[str, Entry]) -> tuple[Recording | None, str]:
    """The recording that some entries give, SI where a unit is open; None and why not."""
    if not entries:
        return None, "no channel of it is known"
    columns = {name: values(entry.channel, entry.unit) for name, entry in entries.items()}
    try:
        found = read_file(
            path, model.channels, {"columns": columns}, needs=model.required, inputs=model.inputs,
            gaps="longest", split=True,
        )  # fmt: skip
    except EmatwinError as error:
        return None, str(error)
    return max(found, key=len), ""


def _find_units(draft: Draft, model: Model, recording: Recording | None, actuator: Any) -> None:
    """Enter the units that are alone plausible, and ask for the others.

    ``recording`` was read with SI for open units; None where it cannot be read.
    """
    needed = {name for group in model.required for part in group for name in part} | {"time"}
    shown = {n: draft.found[entry.channel] for n, entry in draft.entries.items() if entry.is_open}
    left = {name: _of_usual_size(one, draft.channels[name]) for name, one in shown.items()}
    refusals: dict[tuple[str, str], str] = {}
    if recording is not None:
        left = _not_refused(left, model, recording, actuator, refusals)
    for name, one in shown.items():
        entry = _closed(draft.entries[name], one, draft.channels[name], left[name], refusals)
        draft.entries[name] = entry
        if entry.is_open:
            sentence = (
                f"The unit of “{one.name}” ({name}) is stated nowhere, and "
                f"{' or '.join(entry.units)} are equally plausible."
            )
            draft.questions.append(Question(sentence, needed=name in needed))


def _not_refused(
    left: Mapping[str, list[str]], model: Model, recording: Recording, actuator: Any,
    refusals: dict[tuple[str, str], str],
) -> dict[str, list[str]]:  # fmt: skip
    """The units of all combinations that the kind accepts; those it refuses are noted."""
    if len(list(islice(_combinations(left), _MOST_TRIES + 1))) > _MOST_TRIES:
        return dict(left)
    kept: dict[str, set[str]] = {name: set() for name in left}
    for combination, tried in _tried(recording, left, model, actuator):
        for name, unit in combination.items():
            if isinstance(tried, Recording):
                kept[name].add(unit)
            else:
                refusals.setdefault((name, unit), tried)
    if not any(kept.values()):
        return dict(left)  # it is refused for another reason
    return {name: [unit for unit in some if unit in kept[name]] for name, some in left.items()}


def _of_usual_size(one: Surveyed, channel: Channel) -> list[str]:
    """The units with which a channel has a usual size; all of them if none does."""
    units, (low, high) = _USUAL.get(channel.unit, ((channel.unit,), (0.0, math.inf)))
    size = _size(one, channel)
    usual = [
        unit for unit in units if low <= size * unit_factor(unit, channel.unit, one.name) <= high
    ]
    return usual or list(units)


def _size(one: Surveyed, channel: Channel) -> float:
    """The largest magnitude of a channel; the sampling interval of time."""
    if channel.name == "time":
        return (one.high - one.low) / max(one.samples - 1, 1)
    return max(abs(one.low), abs(one.high))


def in_other_units(
    recording: Recording, model: Model, actuator: Any
) -> Iterator[tuple[dict[str, str], Recording]]:
    """Yield a recording with each usual unit for numbers without a stated unit."""
    si = {one.name: one.unit for one in with_time(model.channels)}
    assumed = {
        name: list(_USUAL[si[name]][0])
        for name, account in recording.provenance.get("columns", {}).items()
        if account.get("unit_from") == "assumed" and si.get(name) in _USUAL
        and np.any(recording.channels.get(name))
    }  # fmt: skip
    for combination, tried in _tried(recording, assumed, model, actuator):
        if isinstance(tried, Recording):
            yield {name: unit for name, unit in combination.items() if unit != si[name]}, tried


def _tried(
    recording: Recording, left: Mapping[str, list[str]], model: Model, actuator: Any
) -> Iterator[tuple[dict[str, str], Recording | str]]:
    """Yield the first choices of units with the recording in them, or with why it is refused."""
    for combination in islice(_combinations(left), _MOST_TRIES):
        try:
            scaled = _in_units(recording, combination, model)
            model.check(scaled, actuator)
        except EmatwinError as error:
            yield combination, str(error)
        else:
            yield combination, scaled


def _combinations(left: Mapping[str, list[str]]) -> Iterator[dict[str, str]]:
    """Every choice of units, with one unit for the channels of a series such as three phases."""
    groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for name, units in left.items():
        stem = name[:-2] if name[-2:] in ("_a", "_b", "_c", "_d", "_q") else name
        groups.setdefault((stem, tuple(units)), []).append(name)
    for choice in product(*(units for _, units in groups)):
        chosen = zip(groups.values(), choice, strict=True)
        yield {name: unit for members, unit in chosen for name in members}


def _in_units(recording: Recording, units: Mapping[str, str], model: Model) -> Recording:
    """A recording whose numbers were taken for SI, taken for other units."""
    channels, scaled = {one.name: one for one in with_time(model.channels)}, {}
    for name, unit in units.items():
        values = recording.time if name == "time" else recording.channels.get(name)
        if values is not None:
            scaled[name] = values * unit_factor(unit, channels[name].unit, name)
    for name, account in recording.provenance.get("columns", {}).items():
        derived = channels[name].derived
        if "derived" in account and derived is not None:
            known = recording.channels | scaled
            if not known.keys() >= {*derived.sources}:  # they only stood in for it
                raise RecordError(f"{name} cannot be derived again in other units; state them.")
            scaled[name] = derived.compute(*(known[one] for one in derived.sources))
    return recording.changed(**scaled)


def _closed(
    entry: Entry, one: Surveyed, channel: Channel, units: list[str],
    refusals: Mapping[tuple[str, str], str],
) -> Entry:  # fmt: skip
    """The entry with its unit, where one is left, and why."""
    size = _size(one, channel)

    def as_si(unit: str) -> str:
        number = f"{size * unit_factor(unit, channel.unit, channel.name):.4g} {channel.unit}"
        return f"a sample every {number}" if channel.name == "time" else f"up to {number}"

    if one.low == 0.0 == one.high:
        units = [channel.unit]
        reason = "No unit is stated; it is zero throughout, so none matters."
    elif len(units) != 1:
        return replace(entry, units=tuple(units))
    else:
        usual = _USUAL.get(channel.unit, ((), ()))[0]
        others = [other for other in usual if other != units[0]]
        reason = f"No unit is stated; {units[0]} was taken ({as_si(units[0])})"
        refused = [refusals[key] for o in others if (key := (entry.column, o)) in refusals]
        if refused:
            because = refused[0].partition(". ")[0].rstrip(".")
            reason += f": another would be refused, because “{because}”."
        elif others:
            told = " and ".join(f"in {other} {as_si(other)}" for other in others)
            reason += f": it would be {told}, which is not usual."
    reasons = (*entry.reasons, reason)
    return replace(entry, unit=units[0], unit_from="plausibility", reasons=reasons)
