"""The interactive twin in a notebook (`explore`) and on a local page, as fleets have them as well.

The server listens on the loopback address only, and every address begins with a random token, which
no other page knows. The Host must be the loopback one, so that no foreign name that resolves to it
gets an answer (DNS rebinding). A question must come from the page itself (Origin) and be JSON.
Files are read once, at the start: no path of a request reaches the disk.
"""

import errno
import hmac
import json
import os
import secrets
import threading
from collections.abc import Mapping
from contextlib import nullcontext
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

from ematwin.errors import InputError, MissingExtraError
from ematwin.exploring.explorer import Explorer, StoppedError, answered
from ematwin.models.scenario import Scenario
from ematwin.recordings.recording import Recording

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
# uPlot (github.com/leeoniya/uPlot, MIT, see uPlot.LICENSE) draws the traces. It is part of the
# script, so that neither the page nor the widget of a notebook loads anything from elsewhere.
SCRIPTS = ("uPlot.js", "explore.js")
STYLES = ("uPlot.css", "explore.css")


def asset(*names: str) -> str:
    """Files of the page, one after the other."""
    folder = resources.files("ematwin.exploring").joinpath("page")
    return "\n".join(folder.joinpath(name).read_text("utf-8") for name in names)


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


class LocalServer(ThreadingHTTPServer):
    """A server on the loopback address, whose pages only those find who know its token.

    Port 0 takes a free one. Raises `InputError` if the port cannot be used.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = os.name != "nt"  # there it would share a port that is in use

    def __init__(self, handler: "type[LocalHandler]", port: int = 0) -> None:
        self.token = secrets.token_urlsafe(24)
        try:
            super().__init__(("127.0.0.1", port), handler)
        except (OSError, OverflowError) as refusal:
            in_use = getattr(refusal, "errno", None) == errno.EADDRINUSE
            raise InputError(
                f"Port {port} {'is in use' if in_use else 'cannot be used'}; choose another with "
                "--port, or leave it out for a free one."
            ) from None

    @property
    def hosts(self) -> tuple[str, str]:
        """Names by which a request may address this server."""
        return f"127.0.0.1:{self.server_port}", f"localhost:{self.server_port}"

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{self.hosts[0]}/{self.token}/"


class LocalHandler(BaseHTTPRequestHandler):
    """Answers in the name of a `LocalServer`; it refuses whom the token or the Host gives away."""

    server: LocalServer
    protocol_version = "HTTP/1.1"
    timeout = 30.0  # s, for the rest of a request

    def name(self) -> str | None:
        """What follows the token in the address; None where Host or token are not ours."""
        if self.headers.get("Host") not in self.server.hosts:
            return None
        _, token, *rest = (*self.path.partition("?")[0].split("/"), "")
        known = hmac.compare_digest(token.encode(), self.server.token.encode())
        return "/".join(rest[:-1]) if known and len(rest) > 1 else None

    def refuse(self, status: HTTPStatus) -> None:
        """Answer with a status alone."""
        self.close_connection = True  # a body may be left unread
        self.send(status, f"{status.phrase}\n", "text/plain")

    def send(
        self, status: HTTPStatus, text: str, kind: str, headers: Mapping[str, str] = HEADERS
    ) -> None:
        """Answer with a text."""
        body = text.encode()
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        """The terminal stays quiet."""


class Server(LocalServer):
    """Serves an explorer until it is closed."""

    def __init__(self, explorer: Explorer, port: int = 0) -> None:
        self.explorer = explorer
        self.turn = threading.Lock()
        self.files = {
            "": (asset("page.html"), "text/html"),
            "page.js": (asset("page.js"), "text/javascript"),
            "explore.js": (asset(*SCRIPTS), "text/javascript"),
            "explore.css": (asset(*STYLES), "text/css"),
        }
        super().__init__(_Handler, port)

    def server_close(self) -> None:
        """Stop listening, and end a search that is under way."""
        self.explorer.stopped.set()
        super().server_close()


class _Handler(LocalHandler):
    server: Server

    def do_GET(self) -> None:
        """A file of the page."""
        name = self.name()
        if name is None or name not in self.server.files:
            self.refuse(HTTPStatus.NOT_FOUND)
            return
        text, kind = self.server.files[name]
        self.send(HTTPStatus.OK, text, kind)

    def do_POST(self) -> None:
        """A question of the page."""
        length = self.headers.get("Content-Length", "")
        known = length.isascii() and length.isdigit() and len(length) < 9
        if self.name() != "ask":
            self.refuse(HTTPStatus.NOT_FOUND)
        elif self.headers.get("Origin") not in [f"http://{host}" for host in self.server.hosts]:
            self.refuse(HTTPStatus.FORBIDDEN)
        elif self.headers.get_content_type() != "application/json":
            self.refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        elif not known or int(length) > 65_536:  # bytes of a question
            self.refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._answer(self.rfile.read(int(length)))

    def _answer(self, body: bytes) -> None:
        try:
            question = json.loads(body)
        except (ValueError, RecursionError):
            self.refuse(HTTPStatus.BAD_REQUEST)
            return
        told = isinstance(question, dict) and question.get("ask") == "progress"
        try:
            with nullcontext() if told else self.server.turn:  # progress is told meanwhile
                answer = answered(self.server.explorer, question)
        except StoppedError:
            self.close_connection = True
            return
        self.send(HTTPStatus.OK, json.dumps(answer, allow_nan=False), "application/json")
