"""Both databases under the one contract of a store; damage; stores of earlier versions."""

import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from store_contract import StoreContract, small_plan, some_run

from ematwin.benchmarking.cases import cases_of
from ematwin.benchmarking.execute import execute
from ematwin.benchmarking.plan import Plan
from ematwin.benchmarking.store import Store, open_store
from ematwin.errors import EmatwinError

DATA = Path(__file__).parents[1] / "data"


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
    path = tmp_path / "study.db"
    with Store(path) as store:
        store.begin(small_plan().settings())
        store.save([some_run(spec) for spec in small_plan().specs()])
    assert "6 runs, all as they were written" in ematwin("store", "check", path).out
    whole = path.read_bytes()
    place = whole.rindex(b"budget") + 2
    path.write_bytes(whole[:place] + b"x" + whole[place + 1 :])
    told = ematwin("store", "check", path)
    assert told.code == 2
    assert "is damaged: run " in told.err
    assert "Put a copy in its place" in told.err


@pytest.mark.parametrize(("version", "schema"), [("0.1", 1), ("0.2", 2)])
def test_stores_of_earlier_versions_are_refused_in_a_sentence(
    version: str, schema: int, tmp_path: Path, ematwin: Any
) -> None:
    path = Path(shutil.copy(DATA / version / "study.db", tmp_path / "study.db"))
    whole = path.read_bytes()
    told = ematwin("report", path)
    assert told.code == 2
    assert f"has schema {schema}, and this ematwin knows schema 3" in told.err
    assert ematwin("compare", "--runs", 1, "--store", path).err == told.err
    assert path.read_bytes() == whole


# ematwin compare --algorithms multistart,random --runs 1 --population 10 --iterations 30
#     --scenario step, by 0.2: ids, and what the two found on Low B
FOUND_BY_0_2 = {
    "10b38f14c0b42ee1a5f6e673": (
        0.0000,
        0.0000,
        0.0000,
        0.0000,
        0.0000,
        0.0000,
        0.5000,
        0.5000,
    ),  # multistart
    "373773c389e162fb92cb5677": (
        0.1348,
        0.1308,
        0.0861,
        0.2781,
        0.2216,
        0.1721,
        0.5765,
        0.8268,
    ),  # random
}


def test_runs_of_0_2_come_out_alike_when_done_again() -> None:
    plan = Plan(
        cases_of("paper"), ("multistart", "random"), runs=1, population=10, iterations=30,
        scenario="step",
    )  # fmt: skip
    for spec in plan.specs()[4:6]:
        result = execute(spec)
        assert result.id in FOUND_BY_0_2
        assert result.faults == pytest.approx(FOUND_BY_0_2[result.id], abs=1e-3)
