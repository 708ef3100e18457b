"""Small sizes of benchmarks/faults.py and benchmarks/fuzz.py (docs/reliability.md)."""

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from benchmarks import faults, fuzz

from ematwin.errors import FileError

Numbers = dict[str, tuple[Any, ...]]


@pytest.fixture
def bench(tmp_path: Path, undisturbed: Numbers) -> Iterator[faults.Bench]:
    """Trials with claims that hold for three seconds."""
    once = {id: one for id, one in undisturbed.items() if one[0].run == 0}
    assert len(once) == faults.RUNS
    made = faults.Bench(tmp_path, once, lease=3.0)
    made.chance.seed(1)
    yield made
    made.close()


# killed processes, full disks and servers that stop are tests of their own
@pytest.mark.parametrize("trial", [faults.stopped_beyond_lease, faults.clock_set_back])
def test_a_disturbed_study_ends_as_one_left_alone(trial: Any, bench: faults.Bench) -> None:
    assert trial(bench).startswith("after ")


def test_damaged_files_are_read_or_refused() -> None:
    answers = fuzz.campaign(scale=0.03, only=[])
    assert len(answers) == 210
    assert [one for one in answers if "FAILED" in one["outcome"]] == []
    assert sum(one["outcome"] == "refused" for one in answers) > 50


def test_a_silent_change_would_be_seen(tmp_path: Path) -> None:
    """The judge itself: a store that is read is compared with what it was."""
    stores = fuzz.Stores(tmp_path)
    settings, statuses, runs = stores._before
    stores._before = (settings, {**statuses, "another": "done"}, runs)
    said = set()
    for n in range(20):
        try:
            stores(n, random.Random(n))
        except AssertionError as error:
            said.add(str(error).splitlines()[0])
        except FileError:
            pass
    assert said == {"a changed store was read with other values"}
