"""A store with a flipped bit: it is the same, or one sentence says so, and the rest is rescued."""

import random
from pathlib import Path
from typing import Any

import pytest

from ematwin.comparison.study.rescue import rescue
from ematwin.comparison.study.run import StoredRun
from ematwin.comparison.study.store import Store, open_store
from ematwin.errors import EmatwinError
from ematwin.testing.store_contract import small_plan, some_run

RUNS = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "study.db"
    plan = small_plan(runs=RUNS // 2)
    with Store(path) as store:
        store.begin(plan.settings())
        store.save([some_run(spec) for spec in plan.specs()])
    return path.read_bytes()


def content(path: Path) -> tuple[Any, dict[str, str], dict[str, StoredRun]]:
    with open_store(path) as store:
        return store.settings(), store.statuses(), {one.spec.id: one for one in store.runs()}


def test_no_flipped_bit_goes_unseen(tmp_path: Path, whole: bytes) -> None:
    damaged, out = tmp_path / "damaged.db", tmp_path / "rescued.db"
    damaged.write_bytes(whole)
    before = content(damaged)
    chance, seen = random.Random(1), 0
    for _ in range(24):
        changed = bytearray(whole)
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        damaged.write_bytes(changed)
        said = ""
        try:
            assert content(damaged) == before  # it was in free space
        except EmatwinError as error:
            said = str(error)
        if said:
            seen += 1
            assert "\n" not in said
            assert "damaged" in said
            out.unlink(missing_ok=True)
            lost = rescue(damaged, out).damaged
            settings, _, runs = content(out)
            assert settings == before[0]
            assert runs == {id: before[2][id] for id in runs}
            assert len(runs) + len(lost) == RUNS
            assert len(lost) <= 1
        assert damaged.read_bytes() == changed
    assert seen > 5


def test_a_store_without_a_header_or_a_tree_is_rescued(tmp_path: Path, whole: bytes) -> None:
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(bytes(4096) + whole[4096:])
    with pytest.raises(EmatwinError, match="another kind of file"):
        open_store(damaged)
    assert not rescue(damaged, tmp_path / "rescued.db").damaged
    assert len(content(tmp_path / "rescued.db")[2]) == RUNS


def test_the_commands(tmp_path: Path, whole: bytes, ematwin: Any) -> None:
    path = tmp_path / "study.db"
    path.write_bytes(whole)
    assert f"{RUNS} runs, all as they were written" in ematwin("store", "check", path).out
    place = whole.rindex(b"budget") + 2
    path.write_bytes(whole[:place] + b"x" + whole[place + 1 :])
    told = ematwin("store", "check", path)
    assert told.code == 2
    assert "39 runs are whole, 1 are not" in told.err
    assert told.out.startswith("- run ")
    carried = ematwin("store", "rescue", path, "--out", tmp_path / "rescued.db")
    assert f"wrote {RUNS - 1} runs" in carried.out
    again = ematwin("store", "rescue", path, "--out", tmp_path / "rescued.db")
    assert "holds a study already" in again.err
    nothing = ematwin("store", "rescue", tmp_path / "none.db", "--out", tmp_path / "more.db")
    assert "There is no store" in nothing.err
    path.write_bytes(b"nothing of a store" * 1000)
    assert "Nothing can be rescued" in ematwin("store", "rescue", path, "--out", "new.db").err
    assert not (tmp_path / "new.db").exists()
