"""Both databases under the one contract of a store."""

from pathlib import Path

import pytest

from ematwin.testing.store_contract import StoreContract


class TestSqlite(StoreContract):
    @pytest.fixture
    def where(self, tmp_path: Path) -> Path:
        return tmp_path / "study.db"


class TestPostgres(StoreContract):
    @pytest.fixture
    def where(self, postgres_url: str) -> str:
        return postgres_url
