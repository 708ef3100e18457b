"""Compiled kernels on disk: reused, never out of date, safe for several processes at once.

Processes work on a copy of the package with a cache folder of its own. They run the monitor model,
as it compiles fastest.
"""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ematwin
from ematwin.kernels.cache import NamedByContent

RUN = """
import ematwin
record = ematwin.simulate("monitor", "step", {"friction": 0.5}, sample_rate=1000)
print(ematwin.__file__, record.current.tobytes().hex())
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A folder with a copy of the package and an empty cache beside it."""
    source = Path(ematwin.__file__).parent
    shutil.copytree(source, tmp_path / "ematwin", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def start(copy: Path, code: str = RUN) -> "subprocess.Popen[str]":
    environment = {
        **os.environ,
        "PYTHONPATH": str(copy),
        "NUMBA_CACHE_DIR": str(copy / "cache"),
        "NUMBA_DEBUG_CACHE": "1",
    }
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env=environment, cwd=copy, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def finish(process: "subprocess.Popen[str]", copy: Path) -> tuple[str, list[str]]:
    """The answer of a process, and what numba said of the cache."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    *log, last = out.splitlines()
    place, answer = last.split()
    assert Path(place).is_relative_to(copy)
    return answer, [line for line in log if line.startswith("[cache]")]


def run(copy: Path) -> tuple[str, list[str]]:
    return finish(start(copy), copy)


def kept(copy: Path) -> list[Path]:
    return sorted((copy / "cache").rglob("*.nbc"))


def expected() -> str:
    record = ematwin.simulate("monitor", "step", {"friction": 0.5}, sample_rate=1000)
    assert record.current is not None
    return record.current.tobytes().hex()


def test_the_second_process_compiles_nothing_until_a_step_is_edited(copy):
    answer, log = run(copy)
    assert [line.split()[2] for line in log] == ["saved"]
    again, log = run(copy)
    assert [line.split()[2] for line in log] == ["loaded"]
    assert answer == again == expected()

    # The edited step stands in another file than its loop; the same length and the same time of
    # change: only the content tells.
    step = copy / "ematwin" / "kernels" / "friction.py"
    before = step.stat()
    head, found, tail = step.read_text().partition("def loaded_friction(")
    step.write_text(head + found + tail.replace("return ", "return-", 1))
    os.utime(step, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert step.stat().st_size == before.st_size
    edited, log = run(copy)
    assert [line.split()[2] for line in log] == ["saved"]
    assert edited != answer
    assert len(kept(copy)) == 1  # what is out of date is not kept


def test_processes_that_start_at_once_on_an_empty_cache_agree(copy):
    processes = [start(copy) for _ in range(3)]
    answers = {finish(process, copy)[0] for process in processes}
    assert answers == {expected()}
    assert len(kept(copy)) == 1
    assert list((copy / "cache").rglob("*.tmp.*")) == []
    answer, log = run(copy)
    assert answer == expected()
    assert [line.split()[2] for line in log] == ["loaded"]


def test_without_a_writable_folder_it_compiles_each_time(copy):
    code = "import numba.core.caching as c; c.CacheImpl._locator_classes = []" + RUN
    answer, log = finish(start(copy, code), copy)
    assert answer == expected()
    assert log == []


def test_each_key_has_its_own_file_whatever_the_order_of_writing(tmp_path):
    one, other = (NamedByContent(str(tmp_path), "batch.f-1.py311") for _ in range(2))
    one.save(("float64",), "double")
    other.save(("float32",), "single")
    one.save(("float64",), "double")
    assert (other.load(("float64",)), one.load(("float32",))) == ("double", "single")
    assert one.load(("int64",)) is None
    assert NamedByContent(str(tmp_path), "batch.g-1.py311").load(("float64",)) is None


@pytest.mark.parametrize("damage", [b"", b"half", b"\x80\x04not a pickle"])
def test_a_damaged_file_counts_as_missing_and_is_replaced(tmp_path, damage):
    cache = NamedByContent(str(tmp_path), "batch.f-1.py311")
    cache.save("key", list(range(1000)))
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:500] if damage == b"half" else damage)
    assert cache.load("key") is None
    cache.save("key", "again")
    assert cache.load("key") == "again"


def test_what_other_sources_compiled_to_is_dropped_and_nothing_else(tmp_path):
    stale = tmp_path / "batch.f-7.py311.0123456789abcdef.5.nbc"
    others = [
        tmp_path / "batch.g-7.py311.0123456789abcdef.5.nbc",
        tmp_path / "batch.f-7.py312.0123456789abcdef.5.nbc",
        tmp_path / "notes.txt",
    ]
    for path in (stale, *others):
        path.write_text("x")
    NamedByContent(str(tmp_path), "batch.f-1.py311").save("key", "data")
    assert not stale.exists()
    assert all(path.exists() for path in others)


def test_a_full_disk_does_not_stop_the_work(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    cache = NamedByContent(str(tmp_path), "batch.f-1.py311")
    monkeypatch.setattr(cache, "_dump", full)
    cache.save("key", "data")
    assert cache.load("key") is None
    assert list(tmp_path.iterdir()) == []
