"""Open each page of the built documentation in Chromium: nothing cut off, nothing remote.

    sphinx-build docs docs/_build && python docs/check_site.py docs/_build

Each page is laid out at the widths of a desk, a tablet and a phone. A page fails if it is wider
than its window, if the browser reports an error, or if it loads anything from elsewhere.
"""

import functools
import html
import json
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

WIDTHS = (1400, 768, 390)
_HARNESS = """<!doctype html><title>check</title><pre id="found"></pre><script>
const pages = PAGES, widths = WIDTHS, found = [];
function laidOut(page, width) {
  return new Promise(done => {
    const frame = document.createElement("iframe");
    frame.style = `width:${width}px;height:800px;border:0`;
    frame.onload = () => {
      const inner = frame.contentDocument.documentElement;
      if (inner.scrollWidth > width) found.push([page, width, inner.scrollWidth]);
      for (const each of frame.contentWindow.performance.getEntriesByType("resource"))
        if (new URL(each.name).host !== location.host) found.push([page, width, each.name]);
      frame.remove();
      done();
    };
    frame.src = page;
    document.body.append(frame);
  });
}
(async () => {
  for (const page of pages) for (const width of widths) await laidOut(page, width);
  document.getElementById("found").textContent = JSON.stringify({opened: pages.length, found});
})();
</script>"""


def check(site: Path) -> list[str]:
    """What is wrong with the pages of a site, a sentence each."""
    pages = sorted(str(page.relative_to(site)) for page in site.rglob("*.html"))
    if not pages:
        return [f"{site} holds no page: build it first."]
    harness = site / "check-site.html"
    text = _HARNESS.replace("PAGES", json.dumps(pages)).replace("WIDTHS", json.dumps(WIDTHS))
    harness.write_text(text, encoding="utf-8")
    try:
        shown, said = _browsed(site, harness.name)
    finally:
        harness.unlink()
    answer = re.search(r'<pre id="found">(\{.*?\})</pre>', shown, re.DOTALL)
    if answer is None:
        return [f"The browser did not get through the {len(pages)} pages: {said[-500:]}"]
    found = json.loads(html.unescape(answer[1]))["found"]
    wrong = [f"{page} at {width} px: {what}" for page, width, what in found]
    return wrong + [line for line in said.splitlines() if "CONSOLE" in line and "rror" in line]


def _browsed(site: Path, name: str) -> tuple[str, str]:
    """A page of a served site as the browser holds it, and what the browser said."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("check_site.py needs Chromium: apt-get install chromium.")
    handler = functools.partial(_Quiet, directory=str(site))
    with (
        ThreadingHTTPServer(("127.0.0.1", 0), handler) as server,
        tempfile.TemporaryDirectory() as own,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        done = subprocess.run(
            [
                browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
                f"--user-data-dir={own}", "--enable-logging=stderr", "--log-level=0",
                "--window-size=1500,900", "--timeout=240000", "--virtual-time-budget=240000",
                "--dump-dom", f"http://127.0.0.1:{server.server_port}/{name}",
            ],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )  # fmt: skip
        server.shutdown()
    return done.stdout, done.stderr


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments: object) -> None:
        """Say nothing of requests."""


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("Usage: python docs/check_site.py SITE")
    problems = check(Path(sys.argv[1]))
    print("\n".join(problems) or "All pages fit, and nothing is loaded from elsewhere.")
    sys.exit(bool(problems))
