"""A small size of benchmarks/fuzz.py."""

import random
from pathlib import Path

from benchmarks import fuzz

from ematwin.errors import FileError


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
