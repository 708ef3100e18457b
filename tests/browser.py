"""A page opened in a real browser."""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

WIDTHS = (1400, 768, 390)
# Each page in a frame of each width, and what is seen there: how much wider the page is than its
# frame, what sticks out of it, tables that are cut, figures that are drawn.
_FRAMES = """<!DOCTYPE html><html><body><pre id="seen"></pre><script>
const widths = %s, pages = %s;
const framed = (page, width) => {
  const frame = document.createElement("iframe");
  frame.width = width; frame.height = 2000; frame.src = page;
  return frame;
};
const measured = (frame) => {
  const root = frame.contentDocument.documentElement, width = root.clientWidth;
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
};
(async () => {
  const seen = [];
  for (const page of pages) {
    const frames = widths.map((width) => framed(page, width));
    const loaded = frames.map((one) => new Promise((done) => one.addEventListener("load", done)));
    document.body.append(...frames);
    await Promise.all(loaded);
    await new Promise((done) => setTimeout(done, 1500));
    seen.push(Object.fromEntries(frames.map((one) => [one.width, measured(one)])));
    frames.forEach((one) => one.remove());
  }
  document.getElementById("seen").textContent = JSON.stringify(seen);
})();
</script></body></html>"""


def browse(page: Path, folder: Path, *options: str, milliseconds: int = 10_000) -> tuple[str, str]:
    """The page's document as the browser holds it after a time, and what the browser said."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    assert browser, "This test needs Chromium: apt-get install chromium."
    done = subprocess.run(
        [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
            "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr",
            "--log-level=0", f"--virtual-time-budget={milliseconds}", *options,
            "--dump-dom", page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=300,  # beside other work
        check=False,
    )  # fmt: skip
    return done.stdout, done.stderr


def seen_at(
    pages: Sequence[Path], folder: Path, widths: Sequence[int] = WIDTHS
) -> list[dict[int, dict[str, Any]]]:
    """What each page looks like at several widths: how much too wide, what sticks out of it.

    Fails if the browser has anything to complain of.
    """
    frames = folder / "frames.html"
    addresses = [page.as_uri() for page in pages]
    frames.write_text(_FRAMES % (json.dumps(list(widths)), json.dumps(addresses)), "utf-8")
    document, log = browse(
        frames, folder, "--allow-file-access-from-files",
        milliseconds=10_000 + 3_000 * len(pages),
    )  # fmt: skip
    complaints = [line for line in log.splitlines() if "CONSOLE" in line]
    assert not complaints, complaints
    found = re.search(r'<pre id="seen">(.*?)</pre>', document, re.DOTALL)
    assert found is not None
    assert found[1], "the pages were not measured"
    return [
        {int(width): seen for width, seen in one.items()}
        for one in json.loads(html.unescape(found[1]))
    ]
