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
# The page in a frame of each width, and what it tells of each: how much wider it is than its frame,
# what sticks out of it, tables that are cut, figures that are drawn.
_FRAMES = """<!DOCTYPE html><html><body><pre id="seen"></pre><script>
const widths = %s, page = %s;
addEventListener("load", () => setTimeout(() => {
  const seen = {};
  for (const frame of document.querySelectorAll("iframe")) {
    const root = frame.contentDocument.documentElement, width = root.clientWidth;
    const out = [...root.querySelectorAll("body *")].filter((one) =>
      !one.closest(".scroll, svg, .figure script") && one.getBoundingClientRect().width > 0 &&
      one.getBoundingClientRect().right > width + 1);
    seen[frame.width] = {
      wider: root.scrollWidth - width,
      cut: [...root.querySelectorAll(".scroll")].filter((one) =>
        one.scrollWidth > one.clientWidth + 1).length,
      out: out.slice(0, 3).map((one) => one.outerHTML.slice(0, 80)),
      figures: root.querySelectorAll(".figure .main-svg").length,
    };
  }
  document.getElementById("seen").textContent = JSON.stringify(seen);
}, 1500));
for (const width of widths) {
  const frame = document.createElement("iframe");
  frame.width = width; frame.height = 2000; frame.src = page;
  document.body.append(frame);
}
</script></body></html>"""


def browse(page: Path, folder: Path, *options: str) -> tuple[str, str]:
    """The page's document as the browser holds it, and what the browser said."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    assert browser, "This test needs Chromium: apt-get install chromium."
    done = subprocess.run(
        [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
            "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr",
            "--log-level=0", "--virtual-time-budget=10000", *options, "--dump-dom", page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )  # fmt: skip
    return done.stdout, done.stderr


def seen_at(page: Path, folder: Path, widths: Sequence[int] = WIDTHS) -> dict[int, dict[str, Any]]:
    """What a page looks like at several widths: how much too wide it is, what sticks out of it.

    Fails if the browser has anything to complain of.
    """
    frames = folder / f"frames_{page.stem}.html"
    frames.write_text(_FRAMES % (json.dumps(list(widths)), json.dumps(page.as_uri())), "utf-8")
    document, log = browse(frames, folder, "--allow-file-access-from-files")
    complaints = [line for line in log.splitlines() if "CONSOLE" in line]
    assert not complaints, complaints
    found = re.search(r'<pre id="seen">(.*?)</pre>', document, re.DOTALL)
    assert found is not None
    assert found[1], "the page was not measured"
    return {int(width): seen for width, seen in json.loads(html.unescape(found[1])).items()}
