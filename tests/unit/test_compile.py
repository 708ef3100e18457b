"""Compiled kernels on disk: reused, never out of date, the user's own, safe for several processes.

Processes work on a copy of the package with a cache folder of its own and run the monitor model, as
it compiles fastest; or on a package of somebody else, whose loop compiles in a moment.
"""

import errno
import hashlib
import os
import pickle
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import ematwin
from ematwin.numerics.cache import NamedByContent, folder_for
from ematwin.numerics.claim import Claim
from ematwin.numerics.dependencies import Dependencies
from ematwin.numerics.kinds import UnknownKindError, kind, kind_of_type, text
from ematwin.numerics.machine_code import MachineCode

COMMAND = """
import os, pty, subprocess, sys, threading
ours, theirs = pty.openpty()
seen = b""

def read():
    global seen
    while not seen.endswith(b"end"):
        seen += os.read(ours, 10_000)

reader = threading.Thread(target=read)
reader.start()
command = ["simulate", "--scenario", "step", "--model", "monitor", "--out", "a.csv"]
command = [sys.executable, "-m", "ematwin", *command]
subprocess.run(command, stderr=theirs, stdout=subprocess.DEVNULL, check=True)
os.write(theirs, b"end")
reader.join()
print(seen.decode())
"""

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


def start(copy: Path, code: str = RUN, **changed: str) -> "subprocess.Popen[str]":
    environment = {
        **os.environ,
        # Python takes a source of the same second and length for the one that it has byte code of
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": str(copy),
        "NUMBA_CACHE_DIR": str(copy / "cache"),
        "NUMBA_DEBUG_CACHE": "1",
        **changed,
    }
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env=environment, cwd=copy, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def finish(process: "subprocess.Popen[str]", copy: Path) -> tuple[str, list[str]]:
    """The answer of a process, and what was done with the cache: saved or loaded."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    *log, last = out.splitlines()
    place, answer = last.split()
    assert Path(place).is_relative_to(copy)
    return answer, [line.split()[2] for line in log if line.startswith("[cache]")]


def run(copy: Path, code: str = RUN) -> tuple[str, list[str]]:
    return finish(start(copy, code), copy)


def kept(copy: Path) -> list[Path]:
    return sorted((copy / "cache").rglob("*.nbc"))


def edit(path: Path, old: str, new: str) -> None:
    """Replace text of the same length and keep the time of change: only the content tells."""
    before = path.stat()
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_size == before.st_size


def expected() -> str:
    record = ematwin.simulate("monitor", "step", {"friction": 0.5}, sample_rate=1000)
    assert record.current is not None
    return record.current.tobytes().hex()


def test_the_second_process_compiles_nothing_until_a_step_is_edited(copy):
    answer, log = run(copy)
    assert log == ["saved"]
    again, log = run(copy)
    assert log == ["loaded"]
    assert answer == again == expected()

    # the edited step stands in another file than its loop
    friction = copy / "ematwin" / "numerics" / "friction.py"
    edit(friction, "return t_unloaded + c", "return-t_unloaded + c")
    edited, log = run(copy)
    assert log == ["saved"]
    assert edited != answer
    assert len(kept(copy)) == 1  # what is out of date is not kept


# A package of somebody else: a loop, a step in a second file, the values and types in a third.

PACKAGE = {
    "__init__.py": "",
    "loops.py": """
from ematwin.numerics.compile import loop
from theirs import values
from theirs.steps import advance

@loop
def distance(c, count):
    x = 0.0
    for n in range(count):
        x = advance(x, c) + values.OFFSET
    return x
""",
    "steps.py": """
from ematwin.numerics.compile import step
from theirs.values import GAIN

@step
def advance(x, c):
    return x + GAIN * c.speed
""",
    "values.py": """
from typing import NamedTuple

GAIN = 2.0
OFFSET = 0.5

class Constants(NamedTuple):
    speed: float
    drift: float
""",
}
USE = """
import theirs.loops, theirs.values
c = theirs.values.Constants(speed=3.0, drift=7.0)
print(theirs.__file__, theirs.loops.distance(c, 10))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "theirs"
    folder.mkdir()
    for name, source in PACKAGE.items():
        (folder / name).write_text(source)
    return tmp_path


def test_a_terminal_is_told_that_loops_are_compiled(copy):
    first, second = (start(copy, COMMAND).communicate(timeout=300)[0] for _ in range(2))
    assert first.count("Compiling the twin (first run only") == 1
    assert "Compiling" not in second
    assert "end" in second


def test_a_package_of_somebody_else_is_compiled_once(package):
    assert run(package, USE) == ("65.0", ["saved"])
    assert run(package, USE) == ("65.0", ["loaded"])


@pytest.mark.parametrize(
    ("file", "old", "new", "answer"),
    [
        ("steps.py", "x + GAIN", "x - GAIN", "-55.0"),
        ("values.py", "GAIN = 2.0", "GAIN = 4.0", "125.0"),
        ("values.py", "OFFSET = 0.5", "OFFSET = 1.5", "75.0"),
        ("loops.py", "+ values", "- values", "55.0"),
        # the machine code counts fields by their place, and no name in the loop tells of them
        ("values.py", "speed: float\n    drift", "drift: float\n    speed", "65.0"),
    ],
    ids=["step in another file", "constant of a step", "constant of a module", "loop", "fields"],
)
def test_an_edit_anywhere_in_a_package_of_somebody_else_compiles_anew(
    package, file, old, new, answer
):
    run(package, USE)
    edit(package / "theirs" / file, old, new)
    assert run(package, USE) == (answer, ["saved"])
    assert run(package, USE) == (answer, ["loaded"])


def test_a_file_that_is_edited_after_its_import_is_not_taken_for_what_runs(package):
    steps = package / "theirs" / "steps.py"
    edit_first = f"""
import theirs.loops
from pathlib import Path
path = Path({str(steps)!r})
path.write_text(path.read_text().replace("x + GAIN", "x - GAIN"))
"""
    assert run(package, edit_first + USE) == ("65.0", ["saved"])
    assert run(package, USE) == ("-55.0", ["saved"])


def test_loops_made_around_different_steps_are_kept_side_by_side(package):
    (package / "theirs" / "more.py").write_text(
        """
from ematwin.numerics.compile import loop, step

def looped(advance):
    @loop
    def run(x, count):
        for n in range(count):
            x = advance(x)
        return x
    return run

@step
def doubled(x):
    return 2.0 * x
"""
    )
    use = """
import theirs.more
from ematwin.numerics.scalar import clip
from ematwin.numerics.compile import step
@step
def halved(x):
    return clip(0.5 * x, 0.3, 1.0)
both = [theirs.more.looped(s)(1.0, 3) for s in (theirs.more.doubled, halved)]
print(theirs.__file__, str(both).replace(" ", ""))
"""
    assert run(package, use) == ("[8.0,0.3]", ["saved", "saved"])
    assert run(package, use) == ("[8.0,0.3]", ["loaded", "loaded"])


def test_a_loop_is_compiled_that_calls_one_from_disk(package):
    (package / "theirs" / "more.py").write_text(
        """
from ematwin.numerics.compile import loop

@loop
def inner(x, y):
    for n in range(3):
        x = 0.5 * x + y
    return x

@loop
def outer(x, y):
    return inner(x, y) + inner(y, x)
"""
    )
    one = "import theirs.more; print(theirs.__file__, theirs.more.inner(8.0, 1.0))"
    assert run(package, one) == ("2.75", ["saved"])
    both = one + "; print(theirs.__file__, theirs.more.outer(8.0, 1.0))"
    process = start(package, both)
    # the first one without numba, and again for numba to link it
    assert finish(process, package) == ("16.875", ["loaded", "loaded", "saved"])
    alone = "import theirs.more; print(theirs.__file__, theirs.more.outer(8.0, 1.0))"
    assert run(package, alone) == ("16.875", ["loaded"])


def test_of_processes_that_start_at_once_on_an_empty_cache_one_compiles(package):
    processes = [start(package, USE) for _ in range(3)]
    answers, logs = zip(*[finish(process, package) for process in processes], strict=True)
    assert set(answers) == {"65.0"}
    assert sorted(logs) == [["loaded"], ["loaded"], ["saved"]]
    (folder,) = {path.parent for path in kept(package)}
    assert list(folder.iterdir()) == kept(package)
    assert len(kept(package)) == 1
    assert run(package, USE) == ("65.0", ["loaded"])


def test_without_a_writable_folder_it_compiles_each_time(package):
    (package / "theirs" / "__pycache__").write_text("in the way")
    nowhere = {"HOME": "/proc/none", "XDG_CACHE_HOME": "/proc/none"}
    process = start(package, USE, NUMBA_CACHE_DIR="", **nowhere)
    assert finish(process, package) == ("65.0", [])


def test_nothing_is_read_to_name_the_files_before_the_first_use(tmp_path):
    def asked() -> Dependencies:
        raise AssertionError("too early")

    NamedByContent(tmp_path, "batch.f-1.py311", asked)


# One function


def cache_of(
    folder: Path, function: str = "batch.f-1.py311", sources: str = "s1", **settings: bool
) -> NamedByContent:
    return NamedByContent(folder, function, lambda: Dependencies(sources, "c1"), **settings)


def keep(cache: NamedByContent, key: str, *values: object) -> None:
    cache.save(key, *map(pickle.dumps, values))


def test_each_key_has_its_own_file_whatever_the_order_of_writing(tmp_path):
    one, other = cache_of(tmp_path), cache_of(tmp_path)
    keep(one, "float64", "double", "of numba")
    keep(other, "float32", "single")
    keep(one, "float64", "double", "of numba")
    assert (other.load("float64"), one.load("float32")) == ("double", "single")
    assert (other.load("float64", 1), one.load("float32", 1)) == ("of numba", None)
    assert one.load("int64") is None
    assert cache_of(tmp_path, "batch.g-1.py311").load("float64") is None


@pytest.mark.parametrize("damage", ["empty", "half", "one bit", "not a pickle"])
def test_a_damaged_file_counts_as_missing_and_is_replaced(tmp_path, damage):
    cache = cache_of(tmp_path)
    keep(cache, "key", list(range(1000)))
    path = cache.path("key")
    whole = path.read_bytes()
    path.write_bytes(
        {
            "empty": b"",
            "half": whole[:500],
            "one bit": whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:],
            "not a pickle": b"\x80\x04not a pickle",
        }[damage]
    )
    assert cache.load("key") is None
    keep(cache, "key", "again")
    assert cache.load("key") == "again"


def test_a_process_that_dies_while_it_compiles_keeps_nobody_waiting(tmp_path):
    cache = cache_of(tmp_path)
    keep(cache, "key", "data")
    holds = f"""
import pathlib, time
from ematwin.numerics.claim import Claim
Claim(pathlib.Path({str(cache.path("key"))!r})).take()
print("taken", flush=True)
time.sleep(60.0)
"""
    other = subprocess.Popen([sys.executable, "-c", holds], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline() == "taken\n"
    claim = Claim(cache.path("key"))
    assert claim.take(longest=0.2)  # waited, and goes on all the same
    claim.release()
    other.kill()
    other.wait()
    claim = cache.claim("key")
    assert claim is not None
    assert len(list(cache.folder.iterdir())) == 2
    claim.release()
    assert list(cache.folder.iterdir()) == [cache.path("key")]
    other.stdout.close()


def test_where_no_file_can_be_written_nobody_waits(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert cache_of(tmp_path / "file").claim("key") is None


def test_what_other_sources_compiled_to_is_dropped_and_nothing_else(tmp_path):
    cache = cache_of(tmp_path)
    keep(cache, "first", "data")
    stale = cache.folder / "batch.f-7.py311.0123456789abcdef.5.nbc"
    others = [
        cache.folder / "batch.g-7.py311.0123456789abcdef.5.nbc",
        cache.folder / "batch.f-7.py312.0123456789abcdef.5.nbc",
        cache.folder / "notes.txt",
        tmp_path / "batch.f-7.py311.0123456789abcdef.5.nbc",
    ]
    for path in (stale, *others):
        path.write_text("x")
    keep(cache_of(tmp_path, variants=True), "key", "data")
    assert stale.exists()
    keep(cache, "key", "data")
    assert not stale.exists()
    assert all(path.exists() for path in others)
    assert cache.load("first") == "data"


def test_a_full_disk_does_not_stop_the_work(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    cache = cache_of(tmp_path)
    monkeypatch.setattr(os, "replace", full)
    keep(cache, "key", "data")
    assert cache.load("key") is None
    assert list(cache.folder.iterdir()) == []


# What lies in the cache is run when it is loaded: only the user's own may be

posix = pytest.mark.skipif(os.name != "posix", reason="there are no POSIX rights")
STRANGER = 12345


class Planted:
    """A pickle that leaves a mark where it is read."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> object:
        return Path.touch, (self.mark,)


@pytest.fixture
def planted(tmp_path: Path) -> tuple[NamedByContent, Path]:
    """A cache with a file that, if it is read, leaves a mark; and the path of the mark."""
    cache, mark = cache_of(tmp_path), tmp_path / "mark"
    keep(cache, "key", Planted(mark))
    return cache, mark


def is_refused(cache: NamedByContent, mark: Path) -> bool:
    """Neither read nor written."""
    before = cache.path("key").read_bytes()
    found = cache.load("key")
    keep(cache, "key", "mine")
    return found is None and not mark.exists() and cache.path("key").read_bytes() == before


@posix
def test_files_and_folders_are_for_the_user_alone(planted):
    cache, mark = planted
    assert cache.folder.stat().st_mode & 0o777 == 0o700
    assert cache.path("key").stat().st_mode & 0o777 == 0o600
    cache.load("key")
    assert mark.exists()  # the plant works, where it is let


@posix
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_refused(planted, mode):
    cache, mark = planted
    cache.folder.chmod(mode)
    assert is_refused(cache, mark)


@posix
@pytest.mark.parametrize("mode", [0o660, 0o606, 0o622])
def test_a_file_that_others_can_write_is_refused(planted, mode):
    cache, mark = planted
    cache.path("key").chmod(mode)
    assert is_refused(cache, mark)


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_belongs_to_another_user_is_refused(planted, what):
    cache, mark = planted
    os.chown(cache.folder if what == "folder" else cache.path("key"), STRANGER, -1)
    assert is_refused(cache, mark)


@posix
@pytest.mark.parametrize("what", ["folder", "file"])
def test_a_link_is_refused(planted, what):
    cache, mark = planted
    path = cache.folder if what == "folder" else cache.path("key")
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))
    assert is_refused(cache, mark)
    assert path.is_symlink()


@posix
def test_a_process_works_on_in_a_shared_folder_and_keeps_its_own_files_apart(package):
    shared = package / "cache"
    shared.mkdir()
    shared.chmod(0o777)
    assert run(package, USE) == ("65.0", ["saved"])
    (path,) = kept(package)
    assert path.parent.stat().st_mode & 0o777 == 0o700
    path.parent.chmod(0o777)
    assert run(package, USE) == ("65.0", [])
    path.parent.chmod(0o700)
    assert run(package, USE) == ("65.0", ["loaded"])


def test_sound_data_that_is_of_no_use_is_compiled_anew(package):
    run(package, USE)
    (path,) = kept(package)
    data = pickle.dumps(("not", "what", "we", "keep")) + pickle.dumps(("nor", "what", "numba"))
    path.write_bytes(hashlib.sha256(data).digest() + data)
    # without numba; with as little of it as it takes; with all that it has; then anew
    assert run(package, USE) == ("65.0", ["loaded", "loaded", "loaded", "saved"])
    assert run(package, USE) == ("65.0", ["loaded"])


# Without numba

LOOPS = """
from typing import NamedTuple

import numpy as np
from ematwin.numerics.compile import loop

class Pair(NamedTuple):
    left: float
    right: float

@loop
def rows(count, pair, weights):
    found = np.empty((count, 2))
    for n in range(count):
        found[n, 0] = pair.left * weights[n]
        found[n, 1] = pair.right
    return found

@loop
def refused(x):
    if x < 0.0:
        raise ValueError("below zero")
    return x, Pair(x, 2.0 * x)
"""
USE_LOOPS = """
import sys
import numpy as np
import theirs.loops as loops
found = loops.rows(2, loops.Pair(2.0, 3.0), np.array([1.0, 10.0]))
pair = loops.refused(1.0)
try:
    loops.refused(-1.0)
except ValueError as error:
    said = str(error)
answer = [found.tolist(), pair, type(pair[1]).__name__, said, "numba" in sys.modules]
print(loops.__file__, repr(answer).replace(" ", ""))
"""


def test_a_second_process_gets_arrays_classes_and_errors_without_numba(package):
    (package / "theirs" / "loops.py").write_text(LOOPS)
    answers = "[[[2.0,3.0],[20.0,3.0]],(1.0,Pair(left=1.0,right=2.0)),'Pair','belowzero',{}]"
    assert run(package, USE_LOOPS) == (answers.format(True), ["saved", "saved"])
    loaded = ["loaded", "loaded"] if sys.platform == "linux" else ["loaded"] * 4
    assert run(package, USE_LOOPS) == (answers.format(sys.platform != "linux"), loaded)


def test_numba_compiles_in_a_process_that_ran_machine_code_without_it(package):
    (package / "theirs" / "loops.py").write_text(LOOPS)
    more = """
import numba
import theirs.loops as loops
single = loops.refused(np.float32(2.0))
typed = numba.njit(lambda x: x.sum() + loops.refused(x[0])[0])(np.ones(3))
print(loops.__file__, repr([single[0], typed, loops.refused(3.0)[0]]).replace(" ", ""))
"""
    run(package, USE_LOOPS)
    answer, _ = run(package, USE_LOOPS + more)
    assert answer == "[2.0,4.0,3.0]"


def test_code_that_calls_what_is_not_there_is_left_to_numba(package):
    run(package, USE)
    (path,) = kept(package)
    whole = path.read_bytes()[32:]
    machine = MachineCode._make(pickle.loads(whole))
    asked = machine._replace(external=(*machine.external, "nobody_has_this"))
    data = pickle.dumps(tuple(asked)) + whole[len(pickle.dumps(tuple(machine))) :]
    path.write_bytes(hashlib.sha256(data).digest() + data)
    assert run(package, USE) == ("65.0", ["loaded", "loaded"])


class Fields(NamedTuple):
    first: float
    second: int


@pytest.mark.parametrize(
    "value",
    [
        1.5, 3, True, None, 2j, np.float32(1.0), np.int16(3), np.float64(2.0), np.bool_(True),
        np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3), order="F"), np.zeros((4, 4))[::2, ::2],
        np.zeros(3, np.float32), np.zeros((0, 0)), np.zeros(3, bool), np.arange(3),
        np.broadcast_to(0.0, 3), (), (1.0, 2), (1.0, 2.0), Fields(1.0, 2), ((1.0, None), 2.0),
    ],
    ids=repr,
)  # fmt: skip
def test_a_value_and_the_type_that_numba_gives_it_are_of_one_kind(value):
    from ematwin.numerics.compiler import _type_of

    assert kind(value) == kind_of_type(_type_of(value))


@pytest.mark.parametrize("value", ["text", 2**63, [1.0], np.array(["text"]), {1: 2}])
def test_what_machine_code_is_not_kept_for_is_left_to_numba(value):
    with pytest.raises(UnknownKindError):
        kind(value)


def test_kinds_of_tuples_tell_their_fields_apart():
    other = namedtuple("Fields", ["second", "first"])
    other.__module__ = Fields.__module__
    assert text(kind(Fields(1.0, 2))) != text(kind(other(1.0, 2)))
    assert text(kind((1.0, 2))) == "builtins.tuple(<f8 <i8)"


def test_arguments_may_be_named(package):
    named = "import theirs.more; print(theirs.__file__, theirs.more.scaled(3.0, by=2.0))"
    (package / "theirs" / "more.py").write_text(
        """
from ematwin.numerics.compile import loop

@loop
def scaled(x, by):
    return x * by
"""
    )
    assert run(package, named) == ("6.0", ["saved"])
    assert run(package, named) == ("6.0", ["loaded"])


def test_results_lie_where_numba_keeps_its_own(tmp_path, monkeypatch):
    source = tmp_path / "package" / "loops.py"
    source.parent.mkdir()
    source.write_text("")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "given"))
    given = folder_for(str(source))
    assert given is not None
    assert given.parent == tmp_path / "given"
    assert given.name.startswith("package_")
    (tmp_path / "in the way").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "in the way"))
    assert folder_for(str(source)) == source.parent / "__pycache__"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert folder_for(str(source)) == source.parent / "__pycache__"
    (source.parent / "__pycache__").rmdir()
    (source.parent / "__pycache__").write_text("in the way")
    of_user = folder_for(str(source))
    assert of_user is not None
    assert of_user.is_relative_to(tmp_path / "home")
    typed = folder_for("<ipython-input-1>")
    assert typed is not None
    assert typed.is_relative_to(tmp_path / "home")
    (tmp_path / "home").rename(tmp_path / "gone")
    (tmp_path / "home").write_text("in the way")
    assert folder_for(str(source)) is None
