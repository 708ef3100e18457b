"""A page in a real browser, driven over the pipe of its DevTools protocol.

chromedevtools.github.io/devtools-protocol: JSON messages with a zero byte after each, commands in
on file descriptor 3 and answers out on 4. The standard library is enough for it.
"""

import base64
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WIDTHS = (390, 768, 1400)  # px: a phone's, a tablet's, a desk's
_TALLEST = 16_000  # px of a picture
_DRAWN = """document.readyState === "complete" &&
[...document.querySelectorAll(".figure")].every((one) => one.querySelector(".main-svg"))"""
_SETTLED = "new Promise((done) => setTimeout(done, 200))"
# How much wider the page is than its window, what sticks out of it, tables that are cut, figures
# that are drawn.
_MEASURED = """(() => {
  const root = document.documentElement, width = root.clientWidth;
  const out = [...root.querySelectorAll("body *")].filter((one) =>
    !one.closest(".scroll, svg, .figure script") && one.getBoundingClientRect().width > 0 &&
    one.getBoundingClientRect().right > width + 1);
  return {
    wider: root.scrollWidth - width,
    cut: [...root.querySelectorAll(".scroll")].filter((one) =>
      one.scrollWidth > one.clientWidth + 1).length,
    out: out.slice(0, 3).map((one) => one.outerHTML.slice(0, 80)),
    figures: root.querySelectorAll(".figure .main-svg").length,
  };
})()"""


class Tab:
    """A tab: what it shows, and what it said on its console.

    Attributes
    ----------
    said : messages of the console, of scripts that failed and of the network
    """

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers = commands, answers
        self._rest, self._number, self._where = b"", 0, {}
        self.said: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._where = {"sessionId": attached["sessionId"]}
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """The answer to a command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters, **self._where}
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            heard = self._read()
            if heard.get("id") == self._number:
                assert "error" not in heard, heard
                return heard["result"]
            self._note(heard)

    def open(self, address: str, width: int = 1400, height: int = 900, dark: bool = False) -> None:
        """Go to an address, in a window of this size."""
        self.resize(width, height)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Emulation.setScrollbarsHidden", hidden=True)
        self.call("Page.navigate", url=address)

    def resize(self, width: int, height: int = 900) -> None:
        """Give the window another size."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
            mobile=width < 600,
        )  # fmt: skip

    def value(self, expression: str) -> Any:
        """What JavaScript gives in the page, promises awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = 60.0) -> Any:
        """The first value of an expression that counts as true."""
        end = time.monotonic() + seconds
        while not (found := self.value(expression)):
            assert time.monotonic() < end, f"{expression} stayed {found!r}; console: {self.said}"
            time.sleep(0.05)
        return found

    def show(self, page: Path, width: int = WIDTHS[-1]) -> None:
        """Open a file, and wait until its figures are drawn and laid out."""
        self.open(page.as_uri(), width)
        self.wait(_DRAWN)
        self.value(_SETTLED)

    def picture(self, path: Path) -> None:
        """The page as a PNG; of a very long one the beginning, as a browser refuses more."""
        wide, tall = self.value(
            "[document.documentElement.clientWidth, document.documentElement.scrollHeight]"
        )
        part = {"x": 0, "y": 0, "width": wide, "height": min(tall, _TALLEST), "scale": 1}
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=True, clip=part)
        path.write_bytes(base64.b64decode(shot["data"]))

    def _note(self, heard: dict[str, Any]) -> None:
        told = heard.get("params", {})
        if heard.get("method") == "Log.entryAdded":
            self.said.append(told["entry"]["text"])
        elif heard.get("method") == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.said.append(details.get("exception", {}).get("description", details["text"]))
        elif heard.get("method") == "Runtime.consoleAPICalled":
            self.said.append(str([one.get("value") for one in told["args"]]))

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._answers, 1 << 20)
            assert part, "The browser has ended."
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)


# Moves the pipes to the two descriptors that the browser expects, and becomes the browser.
_START = """
import fcntl, os, sys
high = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
for n, end in enumerate(high):
    os.dup2(end, 3 + n)
os.execv(sys.argv[3], sys.argv[3:])
"""


@contextmanager
def browser(folder: Path) -> Iterator[Tab]:
    """A tab of a browser of its own, with its profile in a folder."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    assert program, "This test needs Chromium: apt-get install chromium."
    commands_in, commands = os.pipe()
    answers, answers_out = os.pipe()
    options = (
        "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-sync "
        "--disable-background-networking --disable-component-update --remote-debugging-pipe"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", _START, str(commands_in), str(answers_out),
         program, *options.split(), f"--user-data-dir={folder / 'profile'}"],
        pass_fds=(commands_in, answers_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(commands_in)
    os.close(answers_out)
    try:
        yield Tab(commands, answers)
    finally:
        os.close(commands)  # the end of its commands ends the browser
        os.close(answers)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def serving(server: Any) -> Iterator[Any]:
    """A server that answers in a thread of its own."""
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def seen_at(pages: Sequence[Path], folder: Path) -> list[dict[int, dict[str, Any]]]:
    """What each page looks like in a window that grows; the browser has nothing to complain of."""
    seen: list[dict[int, dict[str, Any]]] = []
    with browser(folder) as tab:
        for page in pages:
            tab.show(page, WIDTHS[0])
            seen.append({WIDTHS[0]: tab.value(_MEASURED)})
            for width in WIDTHS[1:]:
                tab.resize(width)
                tab.value(_SETTLED)
                seen[-1][width] = tab.value(_MEASURED)
        assert tab.said == []
    return seen
