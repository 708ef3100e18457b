"""The widget of a notebook: the script and the questions of the local page, through the kernel."""

from typing import Any

import anywidget

from ematwin.exploring import assets
from ematwin.exploring.door import answered
from ematwin.exploring.explorer import Explorer


class ExplorerWidget(anywidget.AnyWidget):
    """An explorer in a notebook; its messages are the questions of `ematwin.exploring.door`."""

    _esm = assets.script()
    _css = assets.style()

    def __init__(self, explorer: Explorer) -> None:
        super().__init__()
        self.explorer = explorer
        self.on_msg(self._asked)

    def _asked(self, widget: Any, content: Any, buffers: Any) -> None:
        number = content.get("id") if isinstance(content, dict) else None
        self.send({"id": number, "answer": answered(self.explorer, content)})
