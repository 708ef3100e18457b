"""The first two tasks of docs/trials.md: their commands run, and their answers are the truth."""

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from ematwin.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "trials.md"


def blocks(heading: str) -> list[tuple[str, str]]:
    """Language and text of the blocks of a section of the page."""
    section = PAGE.read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    return re.findall(r"^```(\w+)\n(.*?)^```", section, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture
def done(tmp_path: Path, monkeypatch, capsys):
    """Run a section's blocks in this process, in their order; gives what the last one printed."""
    monkeypatch.chdir(tmp_path)

    def run(heading: str) -> str:
        stated = said = ""
        for language, code in blocks(heading):
            if language == "python":
                exec(code, {})
                continue
            for command in re.findall(r"^\$ ematwin (.*)$", code, re.MULTILINE):
                monkeypatch.setattr(sys, "argv", ["ematwin", *shlex.split(command)])
                with pytest.raises(SystemExit) as left:
                    main()
                assert left.value.code in (0, None)
                said = capsys.readouterr().out
            stated = "".join(re.findall(r"^Friction .*$", code, re.MULTILINE))
        assert re.sub(r"[\d.]+", "#", said.splitlines()[0]) == re.sub(r"[\d.]+", "#", stated)
        return said

    return run


def interval(said: str, fault: str) -> tuple[float, float]:
    """The interval of a fault in SI, as the verdict states it."""
    found = re.search(rf"{fault} [^(]*\([^,]*, ([\d.]+) to ([\d.]+)\)", said)
    assert found, said
    return float(found[1]), float(found[2])


def test_a_bench_file_comes_to_its_verdict(done, tmp_path):
    said = done("Bench file to verdict")
    for fault, truth in (("Friction", 0.033 * 1.6), ("Backlash", 0.005 * (1 + 99 * 0.12))):
        low, high = interval(said, fault)
        assert low <= truth <= high
        assert high - low < 0.15 * truth
    assert (tmp_path / "today.html").stat().st_size > 100_000


def test_a_data_sheet_comes_to_its_twin(done, tmp_path):
    said = done("Data sheet to calibrated twin")
    low, high = interval(said, "Friction")
    assert low <= 0.0255 * 1.4 <= high
    low, high = interval(said, "Short b")
    assert low <= 0.15 * 40 <= high
    twin = tomllib.loads((tmp_path / "twin.toml").read_text(encoding="utf-8"))
    for section, name, truth, share in (
        ("motor", "emf_constant", 0.0492, 0.04), ("motor", "inertia", 3.53e-6, 0.04),
        ("motor", "friction_torque", 0.0135, 0.04), ("controller", "position_gain", 108.0, 0.01),
        ("transmission", "backlash", 0.0065, 0.02),
    ):  # fmt: skip
        assert twin[section][name]["value"] == pytest.approx(truth, rel=share)
