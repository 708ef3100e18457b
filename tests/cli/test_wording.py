"""Sentences of the library become sentences of the shell."""

import sys
from pathlib import Path

import pytest

import ematwin as library
from ematwin.cli.answers import SENTENCES, for_shell, print_table, progress_bar
from ematwin.report.page import Row, Table
from refusals import refused

IDENTIFY = {
    "gaps": "--gaps", "map_file": "--map", "column": "--column", "resample_to": "--resample-to",
    "seed": "--seed", "hold": "--hold", "json": "--json", "only": "--only", "load": "--load",
}  # fmt: skip


SIMULATE = {"sample_rate": "--sample-rate", "step": "--step", "seed": "--seed", "model": "--model"}


@pytest.mark.parametrize(
    ("options", "text", "said"),
    [
        (IDENTIFY, 'Take the longest with gaps="longest", or mask with gaps="mask".',
         "Take the longest with --gaps longest, or mask with --gaps mask."),
        (IDENTIFY, "gaps must be refuse or mask.", "--gaps must be refuse or mask."),
        (IDENTIFY, 'with resample_to="20 kHz".', 'with --resample-to "20 kHz".'),
        (IDENTIFY, "resample_to must be positive.", "--resample-to must be positive."),
        (IDENTIFY, "seed=3 was used.", "--seed 3 was used."),
        (IDENTIFY, 'It looks like mA: give unit = "mA" in the map.',
         'It looks like mA: give unit = "mA" in the file of --map.'),
        (IDENTIFY, 'Map it, such as time="t [ms]", or give sample_rate.',
         'Map it, such as --column time="t [ms]", or give --column sample_rate="20 kHz".'),
        (IDENTIFY, 'Map it, such as load="t [N*m]".', 'Map it, such as --column load="t [N*m]".'),
        (SIMULATE, "sample_rate must be positive.", "--sample-rate must be positive."),
        # English words that are also arguments, names of data and other texts stay
        (IDENTIFY, "The seed must be at least 0.", "The seed must be at least 0."),
        (IDENTIFY, "Faults that only hold gaps.", "Faults that only hold gaps."),
        (SIMULATE, "Give unit in the map.", "Give unit in the map."),
        (SIMULATE, "bad/sample_rate.csv: my_step=3", "bad/sample_rate.csv: my_step=3"),
        (SIMULATE, "no column 'sample_rate'", "no column 'sample_rate'"),
        (SIMULATE, "steps.reference = 1e-6 s", "steps.reference = 1e-6 s"),
        ({}, 'with gaps="longest".', 'with gaps="longest".'),
        ({}, 'No values. Take the longest sound stretch with gaps="longest".', "No values."),
    ],
)  # fmt: skip
def test_arguments_become_options(options, text, said):
    assert for_shell(text, options) == said


def test_a_sentence_that_is_said_otherwise_is_one_of_the_library():
    """As it stands in the source, without the quotes and line breaks between its pieces."""
    sources = Path(library.__file__).parent.rglob("*.py")
    text = "".join(path.read_text() for path in sources if path.name != "answers.py")
    said = "".join(text.split()).replace('""', "").replace('"f"', "")
    assert [one for one in SENTENCES if "".join(one.split()) not in said] == []


@pytest.fixture(scope="module")
def rows():
    step = library.simulate("monitor", "step", {"friction": 0.3}, sample_rate=5000)
    return list(zip(step.time, step.command, step.current, strict=True))


@pytest.mark.parametrize(
    ("header", "change", "said"),
    [
        ("time,command,current", lambda rows: rows[:500] + rows[900:], "with --gaps longest, or"),
        ("command,current", lambda rows: [row[1:] for row in rows],
         'give --column sample_rate="20 kHz".'),
        ("time,command,current", lambda rows: [(*row[:2], 1e3 * row[2]) for row in rows], "--map."),
    ],
    ids=["gaps", "no time", "unit"],
)  # fmt: skip
def test_errors_of_a_command_name_its_options(ematwin, tmp_path, rows, header, change, said):
    lines = [header, *(",".join(f"{value:.9g}" for value in row) for row in change(rows))]
    (tmp_path / "rec.csv").write_text("\n".join(lines))
    refused(ematwin("identify", "rec.csv"), said)


def test_names_in_tables_and_bars_are_no_markup(capsys, monkeypatch):
    rows = [Row(["[bold]demand[/bold] [mm] :warning:"])]
    print_table("of [mm]", Table(["run [/x]"], rows), width=80)
    shown = capsys.readouterr().out
    for text in ("of [mm]", "run [/x]", "[bold]demand[/bold] [mm] :warning:"):
        assert text in shown
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar("Reading rec[/b].csv") as progress:
        progress(0.5)
    assert "rec[/b].csv" in capsys.readouterr().err
