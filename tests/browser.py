"""A page opened in a real browser."""

import shutil
import subprocess
from pathlib import Path


def browse(page: Path, folder: Path) -> tuple[str, str]:
    """The page's document as the browser holds it, and what the browser said."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    assert browser, "This test needs Chromium: apt-get install chromium."
    done = subprocess.run(
        [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
            "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr",
            "--log-level=0", "--virtual-time-budget=10000", "--dump-dom", page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )  # fmt: skip
    return done.stdout, done.stderr
