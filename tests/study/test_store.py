"""Both databases under the one contract of a store; damage; stores of earlier versions."""

import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from ematwin.benchmarking.cases import cases_of
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.store import Store, open_store
from ematwin.errors import EmatwinError
from ematwin.testing.store_contract import StoreContract, small_plan, some_run

DATA = Path(__file__).parents[1] / "data"
# ematwin compare --algorithms multistart,random --runs 1 --population 10 --iterations 30
#     --scenario step, by 0.1 and by 0.2
ASKED = (
    "--algorithms", "multistart,random", "--runs", 1, "--population", 10, "--iterations", 30,
    "--scenario", "step",
)  # fmt: skip


class TestSqlite(StoreContract):
    @pytest.fixture
    def where(self, tmp_path: Path) -> Path:
        return tmp_path / "study.db"


class TestPostgres(StoreContract):
    @pytest.fixture
    def where(self, postgres_url: str) -> str:
        return postgres_url


def content(path: Path) -> tuple[Any, ...]:
    with open_store(path, patience=0.0) as store:
        return store.settings(), store.statuses(), list(store.runs())


def test_no_flipped_bit_goes_unseen(tmp_path: Path) -> None:
    """Such a store is read as it was, where the bit was in free space, or refused."""
    path = tmp_path / "study.db"
    plan = small_plan(runs=20)
    with Store(path) as store:
        store.begin(plan.settings())
        store.save([some_run(spec) for spec in plan.specs()])
    whole, before = path.read_bytes(), content(path)
    chance, said = random.Random(1), []
    for _ in range(60):
        changed = bytearray(whole)
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        path.write_bytes(changed)
        try:
            assert content(path) == before
        except EmatwinError as error:
            said.append(str(error))
        assert path.read_bytes() == changed
    assert len(said) > 20
    assert [one for one in said if "\n" in one] == []
    assert all("is damaged" in one or "another kind of file" in one for one in said)


def test_check_tells_whether_a_store_is_whole(tmp_path: Path, ematwin: Any) -> None:
    path = Path(shutil.copy(DATA / "0.2" / "study.db", tmp_path / "study.db"))
    assert "20 runs, all as they were written" in ematwin("store", "check", path).out
    whole = path.read_bytes()
    place = whole.rindex(b"budget") + 2
    path.write_bytes(whole[:place] + b"x" + whole[place + 1 :])
    told = ematwin("store", "check", path)
    assert told.code == 2
    assert "is damaged: run " in told.err
    assert "Put a copy in its place" in told.err


def test_a_store_of_0_2_is_found_done_and_reported(tmp_path: Path, ematwin: Any) -> None:
    path = Path(shutil.copy(DATA / "0.2" / "study.db", tmp_path / "study.db"))
    answer = json.loads(ematwin("compare", *ASKED, "--store", path, "--json").out)
    assert (answer["planned"], answer["found"], answer["finished"]) == (20, 20, 0)
    told = ematwin("report", path, "--out", tmp_path / "report")
    assert told.code == 0, told.err
    assert "20 of 20 runs ended well" in told.out


def test_runs_of_0_2_come_out_alike_when_done_again() -> None:
    with open_store(DATA / "0.2" / "study.db") as opened:
        stored = {one.spec.id: one for one in opened.runs()}
    plan = Plan(
        cases_of("paper"), ("multistart", "random"), runs=1, population=10, iterations=30,
        scenario="step",
    )  # fmt: skip
    assert {spec.id for spec in plan.specs()} == set(stored)
    for spec in plan.specs()[4:6]:  # multistart and random on Low B
        result, before = execute(spec), stored[spec.id].result
        assert spec == stored[spec.id].spec
        assert result.stopped == before.stopped
        assert result.faults == pytest.approx(before.faults, abs=1e-3)


def test_a_store_of_0_1_is_refused(tmp_path: Path, ematwin: Any) -> None:
    path = Path(shutil.copy(DATA / "0.1" / "study.db", tmp_path / "study.db"))
    told = ematwin("report", path)
    assert told.code == 2
    assert "has schema 1, and this ematwin knows schema 2" in told.err
    assert ematwin("compare", *ASKED, "--store", path).err == told.err
