"""`propose_map`: which channel of a bench's file is which, for a kind of actuator, with reasons."""

from dataclasses import replace
from typing import Any

from ematwin.errors import EmatwinError
from ematwin.models.base import Model
from ematwin.models.registry import load_actuator, model_of
from ematwin.recordings.channel import with_time
from ematwin.recordings.plausible import settled
from ematwin.recordings.proposal import Proposal, propose
from ematwin.recordings.read import read_file
from ematwin.recordings.recording import Recording
from ematwin.recordings.survey import Survey, survey


def propose_map(path: Any, actuator: Any = None, found: Survey | None = None) -> Proposal:
    """Propose a channel map for a file of a test bench.

    Names are compared with words that benches use, units with those of the channels. A unit that
    nobody states is told by plausibility where only one is left. What remains open is asked, and
    never chosen silently.

    Parameters
    ----------
    path : a file that `ematwin.read` knows, or a DataFrame
    actuator : parameters of any kind, the name of a shipped set, or a TOML file, whose limits tell
        what is plausible; the default brushless actuator if not given
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
    channels = {one.name: one for one in with_time(model.channels)}
    proposal = propose(found, model.channels, model.required, model.kind, model.command)
    recording, why = _read(path, model, proposal)

    def check(one: Recording) -> list[str]:
        return model.check(one, chosen)

    needed = {name for group in model.required for part in group for name in part}
    proposal = settled(proposal, found, channels, recording, check, needed)
    if any(one.needed for one in proposal.questions):
        return proposal
    if any(entry.unit_from == "plausibility" for entry in proposal.entries.values()):
        recording, why = _read(path, model, proposal)
    if recording is None:
        return replace(proposal, check=(why,), refused=True)
    try:
        doubts = [*recording.provenance.get("warnings", []), *check(recording)]
    except EmatwinError as error:
        return replace(proposal, check=(str(error),), refused=True)
    return replace(proposal, check=tuple(doubts))


def _read(path: Any, model: Model, proposal: Proposal) -> tuple[Recording | None, str]:
    """The recording that the proposal gives, SI where a unit is open; None and why not."""
    columns: dict[str, Any] = {
        name: {"channel": entry.channel, **({"unit": entry.unit} if entry.unit else {})}
        for name, entry in proposal.entries.items()
    }
    if not columns:
        return None, "no channel of it is known"
    try:
        found = read_file(
            path, model.channels, {"columns": columns}, needs=model.required,
            inputs=[name for name in (model.command, model.load) if name is not None],
            gaps="longest", split=True,
        )  # fmt: skip
    except EmatwinError as error:
        return None, str(error)
    return max(found, key=len), ""
