"""``ematwin explore`` as a process, and its page in a real browser."""

import os
import signal
import socket
import subprocess
import sys
import time
from itertools import product
from urllib.request import urlopen

import numpy as np
import pytest

import ematwin as package
from devtools import browser, serving
from ematwin.exploring.explorer import Explorer
from ematwin.exploring.server import Server
from refusals import refused

INJECTED = {"friction": 2.0, "drive_gain": 0.9}


@pytest.fixture(scope="module")
def recording():
    found = package.simulate(actuator="emps", faults=INJECTED)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(found))  # V
    return found.changed(voltage=found.channels["voltage"] + noise)


def test_the_command_serves_its_page_until_ctrl_c(recording, tmp_path):
    package.write(recording, tmp_path / "rec.parquet")
    command = [sys.executable, "-m", "ematwin", "explore", "rec.parquet", "--actuator", "emps"]
    process = subprocess.Popen(
        [*command, "--no-browser"], cwd=tmp_path, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    address = process.stdout.readline().strip()
    assert address.startswith("http://127.0.0.1:")
    with urlopen(address, timeout=20) as answer:
        assert b"ematwin explore" in answer.read()
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "Ended.\n", "")


def test_what_cannot_be_explored_is_said_in_one_sentence(ematwin, recording, tmp_path):
    package.write(recording, tmp_path / "rec.parquet")
    (tmp_path / "page.html").write_text("<p>no recording</p>", encoding="utf-8")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for arguments, said in (
            (["page.html"], "page.html"),
            (["rec.parquet", "--actuator", "servo48"], "rec.parquet"),
            (["--actuator", "emps", "--port", port], f"Port {port} is in use"),
        ):
            refused(ematwin("explore", *arguments, "--no-browser"), said)


MOVE = """(name, share) => {
  const slider = document.querySelector(`input[data-name=${name}]`);
  slider.value = share * slider.max;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
}"""
SAID = """(name) => document.querySelector(`input[data-name=${name}]`)
  .closest(".ee-row").querySelector("output").textContent"""
MISFIT = "parseFloat(document.querySelector('.ee-misfit strong').textContent)"
PRESS = """(text) =>
  [...document.querySelectorAll("button")].find((one) => one.textContent === text).click()"""
CHOOSE = """(name) => {
  const list = [...document.querySelectorAll("select")].at(-1);
  list.value = name;
  list.dispatchEvent(new Event("change"));
}"""
WATCH = """() => {
  window.shares = [];
  const bar = document.querySelector(".ee-progress");
  new MutationObserver(() => { if (!bar.hidden) window.shares.push(bar.position); })
    .observe(bar, { attributes: true });
}"""
AT_REST = "!document.querySelector('[aria-busy]')"
INK = """(figure) => {
  const canvas = document.querySelector(`.ee-${figure} canvas`);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const colors = new Set();
  for (let n = 0; n < data.length; n += 4) {
    if (data[n + 3] > 200) colors.add(data.slice(n, n + 3).join());
  }
  return [...colors];
}"""


class Leisurely(Explorer):
    """Takes its time, so that the page can ask how far a search is."""

    def _still_wanted(self, *told):
        super()._still_wanted(*told)
        time.sleep(0.1)


@pytest.fixture
def page(recording):
    """The address of the page of a recording whose name is markup."""
    named = recording.changed(source="<b>bold</b>")
    with serving(Server(Leisurely(named, "emps"))) as server:
        yield server.address


def test_the_page_follows_a_slider_fits_and_gives_its_verdict(page, tmp_path):
    with browser(tmp_path) as tab:
        tab.open(page)
        tab.wait("document.querySelectorAll('canvas').length === 4")
        tab.wait(f"{MISFIT} > 0")
        healthy = tab.value(MISFIT)
        assert tab.value(f"({SAID})('friction')") == "20.38 N"

        tab.value(f"({MOVE})('friction', 0.75)")  # halfway from 1 to 4, by its logarithm
        tab.wait(f"({SAID})('friction') === '40.76 N'")
        tab.wait("document.querySelector('.ee-profile h2').textContent.includes('friction')")
        dragged = tab.value(MISFIT)
        assert dragged < healthy
        for figure, tone in (("answer", "213,94,0"), ("profile", "213,94,0"),
                             ("residual", "140,149,159"), ("input", "87,96,106")):  # fmt: skip
            assert tone in tab.value(f"({INK})('{figure}')"), figure

        # two sliders within one answer: the profile is that of the last
        tab.value(f"({MOVE})('viscous', 0.6); ({MOVE})('drive_gain', 0.9)")
        tab.wait("document.querySelector('.ee-profile h2').textContent.includes('drive gain')")
        tab.value(f"({PRESS})('Fit')")
        tab.wait(AT_REST)
        assert tab.value("document.querySelector('.ee-status').textContent").startswith("Fitted")
        assert tab.value(MISFIT) < 0.3 * dragged
        fitted = tab.value("+document.querySelector('input[data-name=friction]').value")
        assert fitted == pytest.approx(750, abs=10)

        tab.value(f"({WATCH})()")
        tab.value(f"({PRESS})('Verdict')")
        tab.wait(AT_REST)
        assert tab.value("window.shares.length") > 0
        assert tab.value("window.shares.every((share) => share > 0 && share <= 1)")
        tab.wait("document.querySelector('.ee-progress').hidden")
        verdict = tab.value("document.querySelector('.ee-verdict').textContent")
        assert "friction +" in verdict
        assert tab.value("document.querySelectorAll('.ee-band:not([hidden])').length") == 6

        tab.value(f"({PRESS})('Healthy')")
        tab.wait(f"({SAID})('friction') === '20.38 N' && {MISFIT} === {healthy}")
        assert tab.value("document.querySelector('.ee-verdict').hidden")

        tab.value(f"({CHOOSE})('position_error')")
        tab.wait("document.querySelector('.ee-answer h2').textContent.includes('Reference less')")
        assert tab.value("document.querySelectorAll('canvas').length") == 4
        assert tab.value("document.querySelector('.ee-source').textContent").startswith("<b>")
        assert tab.said == []


def test_another_scenario_is_chosen_on_the_page(tmp_path):
    with serving(Server(Explorer(None, "servo48"))) as server, browser(tmp_path) as tab:
        tab.open(server.address)
        tab.wait("document.querySelectorAll('.ee-input').length === 2")  # command and load
        assert tab.value("document.querySelectorAll('button').length") == 1
        tab.value(f"({MOVE})('friction', 0.5)")
        tab.wait(f"{MISFIT} > 1")
        tab.value(f"({CHOOSE})('sine')")
        tab.wait("document.querySelectorAll('.ee-input').length === 1")
        assert tab.value("document.querySelector('select').value") == "sine"
        assert tab.value(f"({SAID})('friction')") == "0.03 N m"
        assert tab.said == []


def test_the_page_fits_its_window(page, tmp_path):
    with browser(tmp_path) as tab:
        for width, dark in product((1400, 768, 390), (False, True)):
            tab.open(page, width, 900, dark)
            tab.wait("document.querySelectorAll('canvas').length === 4")
            # no wider than the window, nor is any part of it; labels of the canvas are cut inside
            over = """[...document.querySelectorAll("main *:not(.ee-plot *)")]
              .filter((one) => one.getBoundingClientRect().right > innerWidth + 1)
              .map((one) => one.className || one.tagName)"""
            assert tab.value(over) == []
            assert tab.value("document.documentElement.scrollWidth") == width
            back = "getComputedStyle(document.querySelector('.ematwin-explore')).backgroundColor"
            assert tab.value(back) == ("rgb(20, 24, 29)" if dark else "rgb(255, 255, 255)")
        assert tab.said == []
