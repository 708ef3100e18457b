"""Open each page of the built documentation in Chromium: nothing cut off, nothing remote, no error.

    sphinx-build docs docs/_build && python docs/check_site.py docs/_build [PICTURES]

Each page is opened in a window as wide as a phone's, which then grows to a tablet's and a desk's. A
page fails if it is wider than its window, if the browser reports an error, or if it loads anything
from elsewhere. With a second folder a picture of each page at each width is left there, to be
looked at.
"""

import functools
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devtools import WIDTHS, Tab, browser

_BROWSERS = 2  # that share the pages
_DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
_LOADED = "performance.getEntriesByType('resource').map((each) => each.name)"


def check(site: Path, pictures: Path | None = None) -> list[str]:
    """What is wrong with the pages of a site, a sentence each."""
    pages = sorted(str(page.relative_to(site)) for page in site.rglob("*.html"))
    if not pages:
        return [f"{site} holds no page: build it first."]
    shares = [pages[n::_BROWSERS] for n in range(_BROWSERS)]
    with served(site) as address, ThreadPoolExecutor(_BROWSERS) as pool:
        opened = pool.map(lambda share: _opened(share, address, pictures), shares)
        return sorted(what for share in opened for what in share)


def _opened(pages: Sequence[str], address: str, pictures: Path | None) -> list[str]:
    """What is wrong with some of the pages, opened in a browser of their own."""
    wrong = []
    with tempfile.TemporaryDirectory() as own, browser(Path(own)) as tab:
        for page in pages:
            tab.said.clear()
            tab.open(f"{address}/{page}", WIDTHS[0])
            tab.wait("document.readyState === 'complete'")
            for width in WIDTHS:
                tab.resize(width)
                tab.value(_DRAWN)
                inner = tab.value("document.documentElement.scrollWidth")
                wrong += [f"{page} at {width} px: {inner} px wide"] * (inner > width)
                if pictures is not None:
                    name = page.removesuffix(".html").replace("/", "-")
                    tab.picture(pictures / f"{name}-{width}.png")
            wrong += [f"{page}: {what}" for what in _complaints(tab)]
    return wrong


def _complaints(tab: Tab) -> list[str]:
    """Addresses elsewhere that a page loaded, and complaints of the browser."""
    own = tab.value("location.origin")
    return [each for each in tab.value(_LOADED) if not each.startswith(("data:", own))] + tab.said


@contextmanager
def served(site: Path) -> Iterator[str]:
    """The address of a folder on the loopback address."""
    handler = functools.partial(_Quiet, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


class _Quiet(SimpleHTTPRequestHandler):
    def do_GET(self) -> None:
        """A file of the site; no icon, for which browsers ask on their own."""
        if self.path == "/favicon.ico":
            self.send_response(204)
            self.end_headers()
        else:
            super().do_GET()

    def log_message(self, *arguments: object) -> None:
        """Say nothing of requests."""


def main() -> None:
    """Check the site that is named."""
    if len(sys.argv) not in (2, 3):
        sys.exit("Usage: python docs/check_site.py SITE [PICTURES]")
    folders = [Path(name) for name in sys.argv[1:]]
    for pictures in folders[1:]:
        pictures.mkdir(parents=True, exist_ok=True)
    problems = check(*folders)
    print("\n".join(problems) or "All pages fit, and nothing is loaded from elsewhere.")
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
