"""`explore`: the interactive twin in a notebook."""

from pathlib import Path
from typing import Any

from ematwin.errors import MissingExtraError
from ematwin.models.scenario import Scenario
from ematwin.recordings.recording import Recording


def explore(
    record: Recording | str | Path | None = None,
    actuator: Any = None,
    *,
    scenario: Scenario | str | Path | None = None,
) -> Any:
    """Sliders for the faults, and the twin's answer beside the recording's as one drags.

    Parameters
    ----------
    record : a `Recording`, a file that `ematwin.read` knows, or None: a scenario, and the twin's
        answer beside the healthy one's
    actuator : as `ematwin.identify` takes it
    scenario : where there is no recording; the kind's default if not given

    Returns
    -------
    anywidget.AnyWidget, shown where it is the last line of a cell. ``ematwin explore`` opens the
    same from a shell

    Raises
    ------
    MissingExtraError
        If anywidget is not installed.
    RecordError
        If candidates cannot be compared with the recording.
    InputError
        If an argument cannot be used.
    """
    from ematwin.exploring.door import answered
    from ematwin.exploring.explorer import Explorer
    from ematwin.exploring.server import SCRIPTS, STYLES, asset

    try:
        import anywidget
    except ImportError:
        raise MissingExtraError("anywidget", "explore", "The widget") from None

    class ExplorerWidget(anywidget.AnyWidget):
        _esm = asset(*SCRIPTS)
        _css = asset(*STYLES)

    explorer = Explorer(record, actuator, scenario)
    widget = ExplorerWidget()

    def asked(_: Any, content: Any, buffers: Any) -> None:
        number = content.get("id") if isinstance(content, dict) else None
        widget.send({"id": number, "answer": answered(explorer, content)})

    widget.on_msg(asked)
    return widget
