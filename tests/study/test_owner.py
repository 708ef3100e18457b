"""Whose claim it is, and whether its process still lives."""

import os
import subprocess
import sys

import pytest

from ematwin.comparison.study import owner


def test_a_living_process_is_not_dead() -> None:
    assert not owner.is_dead(owner.owner_name())
    assert str(os.getpid()) in owner.owner_name()


def test_an_ended_process_of_this_boot_is_dead() -> None:
    ended = subprocess.run(
        [
            sys.executable,
            "-c",
            "from ematwin.comparison.study.owner import owner_name; print(owner_name())",
        ],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert owner.is_dead(ended.stdout.strip())


@pytest.mark.parametrize("part", ["boot", "host"])
def test_processes_of_another_machine_are_not_looked_for(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it has another name, or the same name and another boot."""
    owner._place.cache_clear()
    if part == "boot":
        monkeypatch.setattr(owner, "_boot", lambda: "another")
    else:
        monkeypatch.setattr(owner.socket, "gethostname", lambda: "another")
    theirs = f"{owner._place()} 999999999 abc"
    monkeypatch.undo()
    owner._place.cache_clear()
    assert not owner.is_dead(theirs)
    assert owner.is_dead(f"{owner._place()} 999999999 abc")


def test_a_name_of_an_older_ematwin_is_left_to_its_lease() -> None:
    assert not owner.is_dead(f"{owner.socket.gethostname()} pid:[4026531836] 999999999 abc")
