"""Machine code on disk: used again, never out of date, the user's own, safe for several processes.

Processes run a package of somebody else, whose loop compiles in a moment, with a cache of its own.
Each is a fork of one that has loaded numba.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ematwin.numerics.compile import own_folder

# A loop, a step in a second file, the values and types in a third.
PACKAGE = {
    "__init__.py": "",
    "loops.py": """
from ematwin.numerics.compile import loop
from theirs import values
from theirs.steps import advance

@loop
def distance(c, counts):
    x = 0.0
    for n in range(counts[0]):
        x = advance(x, c) + values.OFFSET
    return x
""",
    "steps.py": """
from ematwin.numerics.compile import part, step
from theirs.values import GAIN

@part
def gained(c):
    return GAIN * c.speed

@step
def advance(x, c):
    return x + gained(c)
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
print(theirs.loops.distance(c, (10, 0.5)))
"""


SERVER = """
import json, os, sys, traceback
import numba, ematwin.numerics.compile
numba.njit(lambda x: x + 1.0)(1.0)  # loads the rest of the compiler
sys.dont_write_bytecode = True  # Python takes a source of the same second and length for its own

def answer(code, folder, out):
    sys.path.insert(0, folder)
    os.chdir(folder)
    os.dup2(os.open(out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
    try:
        exec(code, {"__name__": "__main__"})
    except BaseException:
        traceback.print_exc(file=sys.stdout)
        return 1
    finally:
        sys.stdout.flush()
    return 0

for line in sys.stdin:
    asked, children = json.loads(line), []
    for code, out in asked["processes"]:
        child = os.fork()
        if not child:
            os.environ.update(asked["environment"])
            os._exit(answer(code, asked["folder"], out))
        children.append(child)
    print(json.dumps([os.waitpid(child, 0)[1] for child in children]), flush=True)
"""


@pytest.fixture(scope="module")
def server():
    """Starts processes; numba is loaded once."""
    with subprocess.Popen(
        [sys.executable, "-c", SERVER],
        env={**os.environ, "NUMBA_DEBUG_CACHE": "1"},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as running:  # fmt: skip
        yield running
        running.stdin.close()


class Package:
    """A folder with the package, and an empty cache beside it."""

    def __init__(self, folder, server):
        self.folder, self._server = folder, server
        self.cache = folder / "cache"

    def start(self, *codes, **changed):
        """The answer of each of some processes, and what was done with machine code.

        They run at the same time. Machine code is saved or loaded.
        """
        outs = [str(self.folder / f"out{n}.txt") for n in range(len(codes))]
        asked = {
            "folder": str(self.folder),
            "processes": list(zip(codes, outs, strict=True)),
            "environment": {"NUMBA_CACHE_DIR": str(self.cache), **changed},
        }
        print(json.dumps(asked), file=self._server.stdin, flush=True)
        statuses = json.loads(self._server.stdout.readline())
        found = []
        for status, out in zip(statuses, outs, strict=True):
            text = Path(out).read_text()
            assert status == 0, text
            *log, answer = text.splitlines()
            done = [line.split()[2] for line in log if line.startswith("[cache] data")]
            found.append((answer, done))
        return found


@pytest.fixture
def package(tmp_path, server):
    folder = tmp_path / "theirs"
    folder.mkdir()
    for name, source in PACKAGE.items():
        (folder / name).write_text(source)
    return Package(tmp_path, server)


def run(package, code=USE, **changed):
    return package.start(code, **changed)[0]


def kept(package):
    return sorted(package.cache.rglob("*.nbc"))


def edit(path, old, new):
    """Replace text of the same length and keep the time of change: only the content tells."""
    before = path.stat()
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_size == before.st_size


EDITS = {
    "step in another file": ("steps.py", "x + gained", "x - gained", "-55.0"),
    "part of a step": ("steps.py", "GAIN * c", "GAIN + c", "-45.0"),
    "constant of a module": ("values.py", "OFFSET = 0.5", "OFFSET = 1.5", "-35.0"),
    # the machine code counts fields by their place, and no name in the loop tells of them
    "fields": ("values.py", "speed: float\n    drift", "drift: float\n    speed", "-35.0"),
}


def test_the_second_process_compiles_nothing_until_something_is_edited(package):
    assert run(package) == ("65.0", ["saved"])
    assert run(package) == ("65.0", ["loaded"])
    for what, (file, old, new, answer) in EDITS.items():
        edit(package.folder / "theirs" / file, old, new)
        assert run(package) == (answer, ["saved"]), what
    assert run(package) == (answer, ["loaded"])


def test_of_processes_that_start_at_once_one_compiles_for_all(package):
    answers, done = zip(*package.start(USE, USE, USE), strict=True)
    assert set(answers) == {"65.0"}
    assert sorted(done) == [["loaded"], ["loaded"], ["saved"]]


def test_a_process_that_was_killed_while_it_saved_leaves_nothing_that_is_loaded(package):
    run(package)
    (path,) = kept(package)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert run(package) == ("65.0", ["saved"])
    path.unlink()  # the index names a file that is not there
    assert run(package) == ("65.0", ["saved"])
    assert run(package) == ("65.0", ["loaded"])


def test_where_nothing_can_be_kept_it_compiles_each_time(package):
    (package.folder / "file").write_text("in the way")
    assert run(package, NUMBA_CACHE_DIR=str(package.folder / "file")) == ("65.0", [])
    full = "import os\ndef full(*_): raise OSError(28, 'full')\nos.replace = full\n"
    assert run(package, full + USE) == ("65.0", [])
    assert kept(package) == []


# What lies in the cache is run when it is loaded: only the user's own may be.


def owned_by_a_stranger(folder):
    if os.geteuid() != 0:
        pytest.skip("only root gives files away")
    os.chown(folder, 12345, -1)


def replaced_by_a_link(folder):
    folder.symlink_to(folder.rename(folder.with_name("elsewhere")))


@pytest.mark.skipif(os.name != "posix", reason="there are no POSIX rights")
@pytest.mark.parametrize(
    "change",
    [lambda folder: folder.chmod(0o770), owned_by_a_stranger, replaced_by_a_link],
    ids=["others write", "a stranger's", "a link"],
)
def test_a_folder_that_is_not_the_users_own_is_not_taken(tmp_path, monkeypatch, change):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = own_folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    change(folder)
    assert own_folder() is None
