"""The pages of a fleet on this machine, as the store has them at each request; nothing is written.

Who may ask is decided as for the explorer (`ematwin.exploring.server`): loopback, a token in the
address, the Host. A request names an actuator of the store or nothing; no path of it reaches the
disk. Only scripts whose hash the page states run.
"""

import base64
import hashlib
import re
import threading
from http import HTTPStatus
from urllib.parse import unquote

from ematwin.errors import EmatwinError
from ematwin.exploring.server import HEADERS, LocalHandler, LocalServer
from ematwin.fleet.fleet import Fleet
from ematwin.fleet.pages import actuator_page, fleet_page

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)


class FleetServer(LocalServer):
    """Serves a fleet until it is closed; port 0 takes a free one."""

    def __init__(self, fleet: Fleet, port: int = 0) -> None:
        self.fleet = fleet
        self.turn = threading.Lock()
        self._pages: dict[str, str] = {}
        self._version: tuple[str, ...] = ()
        super().__init__(_Handler, port)

    def page(self, serial_number: str) -> str | None:
        """A page; of the fleet for "", None for an actuator that there is not."""
        with self.turn:
            self.fleet.refresh()
            if self.fleet.version != self._version:
                self._version, self._pages = self.fleet.version, {}
            if serial_number == "" and "" not in self._pages:
                self._pages[""] = fleet_page(self.fleet, link="{serial}")
            elif serial_number in self.fleet and serial_number not in self._pages:
                self._pages[serial_number] = actuator_page(self.fleet[serial_number])
            return self._pages.get(serial_number)


class _Handler(LocalHandler):
    server: FleetServer

    def do_GET(self) -> None:  # noqa: N802 (the name of the standard library)
        """A page."""
        name = self.name()
        try:
            page = None if name is None else self.server.page(unquote(name))
        except EmatwinError as error:
            self.send(HTTPStatus.INTERNAL_SERVER_ERROR, f"{error}\n", "text/plain")
            return
        if page is None:
            self.refuse(HTTPStatus.NOT_FOUND)
        else:
            self.send(HTTPStatus.OK, page, "text/html", headers_of(page))


def headers_of(page: str) -> dict[str, str]:
    """Headers that let the scripts of this page run, and no others."""
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
        for script in _SCRIPT.findall(page)
    )
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    )
    # a screen on the wall asks again after so many seconds
    return HEADERS | {"Content-Security-Policy": policy, "Refresh": "300"}
