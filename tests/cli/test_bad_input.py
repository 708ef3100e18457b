"""What an impatient user may type: one sentence, exit code 2, no answer, no half-written file."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import ematwin as library
from refusals import refused, untouched

OUT = ("--out", "rec.parquet")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with good and bad files to try."""
    folder = tmp_path_factory.mktemp("files")

    def text(name: str, body: str) -> None:
        (folder / name).write_text(body, encoding="utf-8")

    text("good.csv", "time,command\n0,0\n0.2,0.001\n")
    text("text.csv", "time,command\n0,0\n0.2,abc\n0.3,def\n")
    text("degrees.csv", "time,command\n0,0\n0.2,20\n0.3,0\n")
    text("header.csv", "time,command\n")
    text("empty.csv", "")
    text("sheet.xlsx", "time,command\n0,0\n0.2,0.001\n")
    text("endless.toml", 'duration = 1e12\n[[command]]\ntype = "step"\nvalue = 0.01\n')
    text("runs.csv", "path,actuator\nlost.parquet,servo48\n")
    (folder / "binary.toml").write_bytes(bytes(range(256)))
    (folder / "binary.parquet").write_bytes(bytes(range(256)) * 8)
    (folder / "folder.parquet").mkdir()
    record = library.simulate("monitor", sample_rate=2000)
    library.write(record, folder / "whole.parquet")
    whole = (folder / "whole.parquet").read_bytes()
    (folder / "whole.parquet").unlink()
    (folder / "truncated.parquet").write_bytes(whole[: len(whole) // 2])
    from ematwin.models.registry import shipped_actuators

    shipped = shipped_actuators()["servo48"].read_text(encoding="utf-8")
    for name, old, new in (
        ("inductance", "inductance = { value = 0.72", "inductance = { value = -0.72"),
        ("slow", 'monitor = { value = 50, unit = "us"', 'monitor = { value = 10, unit = "ms"'),
    ):
        assert old in shipped
        text(f"{name}.toml", shipped.replace(old, new))
    return folder


CASES = [
    # faults
    (["--fault", "fricton=0.25"], "Did you mean friction?"),
    (["--fault", "friction=25"], "If this is a percentage, write 0.25"),
    (["--fault", "friction=a lot"], "received 'a lot'"),
    (["--fault", "friction=0,25"], "received '0,25'"),
    (["--fault", "friction"], "needs name=value, received 'friction'"),
    (["--fault", ""], "needs name=value"),
    (["--fault", "friction=0.1", "--fault", "friction=0.2"], "gives friction twice"),
    (["--fault"], "requires an argument"),
    # numbers
    (["--seed", "text"], "received 'text'"),
    (["--seed=-1", "--noise", "white=0.1"], "received -1"),
    (["--sample-rate", "-5"], "received -5"),
    (["--sample-rate", "20 kHz"], "received '20 kHz'"),
    (["--step", "1"], "received 1 s"),
    (["--noise", "white=-1"], "received -1"),
    # names
    (["--model", "refrence"], "choose reference or monitor"),
    (["--actuator", "servo49"], "Shipped: servo48"),
    (["--scenario", "defualt"], "Shipped: default"),
    (["--nonsense"], "No such option: --nonsense"),
    (["extra"], "extra"),
    # scenario files
    (["--scenario", "none.toml"], "No such file"),
    (["--scenario", "none.csv"], "There is no file none.csv"),
    (["--scenario", "text.csv"], "Column command of text.csv must hold numbers; it holds 'abc'"),
    (["--scenario", "degrees.csv"], "It looks like degrees"),
    (["--scenario", "header.csv"], "header and no rows"),
    (["--scenario", "empty.csv"], "empty"),
    (["--scenario", "sheet.xlsx"], "Cannot read sheet.xlsx as xlsx"),
    (["--scenario", "binary.parquet"], "Cannot read binary.parquet as parquet"),
    (["--scenario", "truncated.parquet"], "may be truncated"),
    (["--scenario", "folder.parquet"], "is a folder"),
    (["--scenario", "binary.toml"], "not text"),
    (["--scenario", "endless.toml"], "shorten the scenario"),
    # parameter files
    (["--actuator", "none.toml"], "No such file"),
    (["--actuator", "inductance.toml"], "motor.inductance must be greater than 0"),
    (["--actuator", "slow.toml"], "received 0.01 s"),
    # targets
    (["--out", "."], "end its name in .parquet or .csv"),
    (["--out", "rec.xlsx"], "end its name in .parquet or .csv"),
    (["--out", "folder.parquet"], "it is a folder"),
    (["--out", "none/rec.parquet"], "folder none is missing"),
    (["--out", "empty.csv/rec.parquet"], "Cannot write empty.csv/rec.parquet"),
    (["--plot", "rec.png"], "end its name in .html"),
    (["--scenario", "good.csv", "--out", "good.csv"], "overwrite its own input"),
]


@pytest.mark.parametrize(("arguments", "said"), CASES, ids=[" ".join(case[0]) for case in CASES])
def test_simulate_refuses_in_one_sentence(files, arguments, said):
    more = [] if "--out" in arguments else OUT
    untouched(files, "simulate", "--model", "monitor", *more, "--json", *arguments, said=said)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("simulat", "No such command 'simulat'"),
        ("--colour", "No such option: --colour"),
        ("actuators servo49", "Shipped: servo48"),
        ("actuators none.toml", "No such file"),
        ("actuators inductance.toml", "motor.inductance must be greater than 0"),
        ("actuators folder.parquet", "There is no actuator"),
        ("scenarios extra", "extra"),
        ("units --quick", "No such option: --quick"),
        ("identify none.csv", "There is no file none.csv"),
        ("identify good.csv", "good.csv has no channel for current_a"),
        ("identify header.csv", "holds a header and no rows"),
        ("identify empty.csv", "empty.csv is empty"),
        ("identify sheet.xlsx", "Cannot read sheet.xlsx as xlsx"),
        ("identify binary.parquet", "Cannot read binary.parquet as parquet"),
        ("identify folder.parquet", "folder.parquet holds no recording"),
        ("identify *.mf4", "*.mf4 holds no recording"),
        ("identify runs.csv", "There is no file lost.parquet"),
        (
            "identify runs.csv good.csv",
            "runs.csv is a table of runs (a column path); give it alone",
        ),
        ("detect good.csv", "detect needs a calibrated actuator"),
        ("detect good.csv --actuator slow.toml", "slow.toml holds an actuator but no calibration"),
        ("identify good.csv --units angel=mrad", "--units must name quantities of angle"),
        ("identify good.csv --fail-on broken", "--fail-on takes fault, changed and none"),
        ("identify good.csv --actuator servo48 --column i_a", "received 'i_a'"),
        ("identify good.csv --report page.pdf", "end its name in .html"),
        ("identify good.csv --table t.xlsx", "end its name in .csv or .parquet"),
        ("identify good.csv --gaps maybe", "--gaps must be refuse, longest, mask"),
        ("identify good.csv --resample-to fast", "--resample-to must be a number"),
        ("calibrate good.csv --out none/x.toml", "the folder none is missing"),
        ("calibrate good.csv --actuator slow.toml --out slow.toml", "replace it with --force"),
        ("channels none.csv", "There is no file none.csv"),
        ("units mrad", 'Give units such as "angle=mrad'),
    ],
)
def test_other_commands_refuse_in_one_sentence(files, command, said):
    untouched(files, *command.split(), said=said)


def test_the_installed_script_refuses_alike(tmp_path):
    script = Path(sys.executable).parent / "ematwin"
    done = subprocess.run(
        [script, "simulate", "--fault", "fricton=0.25"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("Error: Unknown fault 'fricton'. Did you mean friction?")


def test_a_read_only_folder_is_refused_before_the_work(ematwin):
    folder = Path("/proc/sys")  # root cannot write here either
    for option, name in (("--out", "rec.csv"), ("--plot", "rec.html")):
        # each step of a nanosecond: the simulation itself would take minutes
        answer = ematwin("simulate", "--step", "1e-9", option, folder / name)
        refused(answer, f"the folder {folder} is missing or read-only")


def test_an_existing_record_survives_a_refusal(ematwin, tmp_path):
    (tmp_path / "rec.parquet").write_text("precious")
    refused(ematwin("simulate", "--fault", "friction=2", *OUT), "received 2")
    assert (tmp_path / "rec.parquet").read_text() == "precious"


@pytest.fixture
def hour(tmp_path: Path) -> Path:
    """A scenario that takes the reference model minutes."""
    path = tmp_path / "hour.toml"
    path.write_text('duration = 400\n[[command]]\ntype = "sine"\namplitude = 0.01\nfrequency = 2\n')
    return path


@pytest.mark.parametrize("moment", [0.0, 4.0])
def test_ctrl_c_ends_with_130_and_leaves_nothing(hour, tmp_path, moment):
    (tmp_path / "rec.parquet").write_text("precious")
    process = subprocess.Popen(
        [sys.executable, "-m", "ematwin", "simulate", "--scenario", hour, "--sample-rate", "1000",
         *OUT, "--plot", "rec.html"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        _wait_until_python_answers(process)
        time.sleep(moment)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    # Python itself ends by the signal where it struck within an import; shells show 130 for both
    assert process.returncode in (130, -signal.SIGINT), err
    assert out == ""
    assert err == "Interrupted; nothing was left half-written.\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hour.toml", "rec.parquet"]
    assert (tmp_path / "rec.parquet").read_text() == "precious"


def _wait_until_python_answers(process: "subprocess.Popen[str]") -> None:
    """Until the package is being imported: what comes before is Python's own start."""
    maps = Path(f"/proc/{process.pid}/maps")
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if "numpy" in maps.read_text():
            return
        time.sleep(0.01)


@pytest.mark.parametrize("size", [0, 99])
def test_damaged_parquet_is_never_a_traceback(ematwin, tmp_path, size):
    rng = np.random.default_rng(size)
    (tmp_path / "noise.parquet").write_bytes(b"PAR1" + rng.bytes(size) + b"PAR1")
    refused(ematwin("simulate", "--scenario", "noise.parquet"), "Cannot read noise.parquet")


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("actuators servo48 > /dev/full", 2, "Error: Cannot write the answer: No space left"),
        ("actuators servo48 >&-", 0, ""),
        ("actuators servo48 | head -n 1", 0, ""),  # which has seen enough
        ("identify none.csv 2>&-", 2, ""),
        ("identify pipe.csv", 2, "Error: pipe.csv is a pipe or a device; save the recording"),
    ],
)
def test_a_stream_that_takes_no_more_ends_in_one_sentence(tmp_path, command, code, said):
    os.mkfifo(tmp_path / "pipe.csv")
    done = subprocess.run(
        f"{sys.executable} -m ematwin {command}", shell=True, cwd=tmp_path, capture_output=True,
        text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == code
    assert done.stderr.startswith(said)
    assert done.stderr.count("\n") == bool(said)


def test_an_encoding_that_lacks_a_sign_is_no_error(ematwin_process, tmp_path):
    library.simulate("monitor").save(tmp_path / "rec.parquet")
    answer = ematwin_process("channels", "rec.parquet", PYTHONIOENCODING="cp1252")
    assert answer.code == 0, answer.err
    assert "taken for" in answer.out
