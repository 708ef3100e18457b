"""Machine code on disk: used again, never out of date, the user's own, safe for several processes.

Processes run a package of somebody else, whose loop compiles in a moment, with a cache of its own.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from commands import fresh
from ematwin.numerics.compile import own_folder

LOOPS = """
from ematwin.numerics.compile import loop
from theirs.steps import advance

@loop
def distance(c, counts):
    x = 0.0
    for n in range(counts[0]):
        x = advance(x, c)
    return x
"""
STEPS = """
from typing import NamedTuple
from ematwin.numerics.compile import part, step

class Constants(NamedTuple):
    speed: float
    drift: float

@part
def gained(c):
    return 2.0 * c.speed

@step
def advance(x, c):
    return x + gained(c)
"""
USE = """
from theirs import loops, steps
x = loops.distance(steps.Constants(speed=3.0, drift=7.0), (10, 0.5))
print(x, "loaded" if sum(loops.distance.stats.cache_hits.values()) else "compiled")
"""


class Package:
    """A folder with the package, and an empty cache beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.cache = folder, folder / "cache"
        (folder / "theirs").mkdir()
        for name, source in (("__init__", ""), ("loops", LOOPS), ("steps", STEPS)):
            (folder / "theirs" / f"{name}.py").write_text(source)

    def run(self, cache: Path | None = None) -> str:
        """What a process finds, and whether it had to compile."""
        done = fresh(USE, folder=self.folder, NUMBA_CACHE_DIR=str(cache or self.cache))
        assert done.code == 0, done.err
        return done.out.strip()

    def edit(self, old: str, new: str) -> None:
        """Replace text of the same length and keep the time of change: only the content tells."""
        path = self.folder / "theirs" / "steps.py"
        before, text = path.stat(), path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert path.stat().st_size == before.st_size


@pytest.fixture
def package(tmp_path: Path) -> Package:
    return Package(tmp_path)


def test_code_is_loaded_again_until_it_is_damaged_or_what_it_depends_on_is_edited(package):
    assert package.run() == "60.0 compiled"
    assert package.run() == "60.0 loaded"
    (code,) = package.cache.rglob("*.nbc")
    code.write_bytes(code.read_bytes()[:500])  # of a process that was killed while it wrote
    assert package.run() == "60.0 compiled"
    package.edit("2.0 * c", "2.0 + c")  # in a part of a step in another file
    assert package.run() == "50.0 compiled"
    # the machine code counts fields by their place, and no name in the loop tells of them
    package.edit("speed: float\n    drift", "drift: float\n    speed")
    assert package.run() == "50.0 compiled"


def test_of_processes_that_start_at_once_one_compiles_for_all(package):
    with ThreadPoolExecutor(3) as several:
        found = sorted(several.map(lambda _: package.run(), range(3)))
    assert found == ["60.0 compiled", "60.0 loaded", "60.0 loaded"]


def test_where_nothing_can_be_kept_it_compiles_each_time(package, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert package.run(tmp_path / "file") == "60.0 compiled"


def owned_by_a_stranger(folder: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root gives files away")
    os.chown(folder, 12345, -1)


def replaced_by_a_link(folder: Path) -> None:
    folder.symlink_to(folder.rename(folder.with_name("elsewhere")))


@pytest.mark.skipif(os.name != "posix", reason="there are no POSIX rights")
@pytest.mark.parametrize(
    "change",
    [lambda folder: folder.chmod(0o770), owned_by_a_stranger, replaced_by_a_link],
    ids=["others write", "a stranger's", "a link"],
)
def test_a_folder_that_is_not_the_users_own_is_not_taken(tmp_path, monkeypatch, change):
    """What lies in it is run when it is loaded."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = own_folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    change(folder)
    assert own_folder() is None
