"""Names, aliases, entry points, missing libraries, and what importing costs."""

import importlib.util
import subprocess
import sys
import warnings

import pytest

from ematwin.errors import InputError, MissingExtraError
from ematwin.optimizers import Box, Optimizer, Whale, algorithms, create, minimize
from ematwin.optimizers.registry import find
from ematwin.testing.optimizer_contract import CHECKS, check_optimizer

BOX = Box([0.0, 0.0], [1.0, 1.0])


def test_every_name_and_alias_is_told_once():
    names = [name for found in algorithms() for name in (found.name, *found.aliases)]
    assert len(names) == len(set(names))


def test_every_algorithm_says_where_it_comes_from():
    for found in algorithms():
        assert found.title
        assert found.source
        assert isinstance(create(found.name, BOX), Optimizer)


def test_aliases_and_spelling_lead_to_the_same():
    assert find("CMA_ES").name == "cma"
    assert find(" Grey-Wolf ").name == "gwo"


def test_a_wrong_name_suggests_the_closest():
    with pytest.raises(InputError, match=r"no algorithm 'wao'.*woa"):
        find("wao")


def test_a_missing_library_names_the_command(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not find("pygmo-de").installed
    assert find("gwo").installed
    with pytest.raises(MissingExtraError, match=r'pip install "ematwin\[bench\]"'):
        create("pygmo-de", BOX)


@pytest.fixture
def somebody(tmp_path, monkeypatch):
    """An installed package with three algorithms."""
    info = tmp_path / "somebody-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: somebody\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        """
[ematwin.optimizers]
mine = ematwin.optimizers:Whale
gwo = ematwin.optimizers:Whale
broken = no_such_module:Nothing
"""
    )
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.usefixtures("somebody")
def test_an_entry_point_is_listed_run_and_never_takes_over_a_name():
    assert isinstance(create("mine", BOX), Whale)
    assert find("mine").origin == "somebody"
    assert find("gwo").origin == "ematwin"
    assert isinstance(create("somebody:gwo", BOX), Whale)
    result = minimize(lambda p: (p**2).sum(axis=1), [0, 0], [1, 1], "mine", iterations=3)
    assert result.algorithm == "mine"
    with pytest.raises(InputError, match="'broken' cannot be loaded"):
        create("broken", BOX)


def test_importing_the_optimisers_imports_no_other_library():
    code = (
        "import sys, ematwin.optimizers as o; o.algorithms();"
        "print([m for m in ('cma','pymoo','pygmo','nevergrad','scipy','pytest','numba') "
        "if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


class _Outside(Whale):
    """Leaves the box."""

    def ask(self):
        return super().ask() + 100.0

    def tell(self, points, costs):
        super().tell(super().ask(), costs)


def test_the_contract_finds_a_method_that_breaks_it():
    with pytest.raises(AssertionError, match="outside the box"):
        check_optimizer(_Outside)


def test_the_contract_runs_without_pytest():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_optimizer(Whale)
    assert len(CHECKS) >= 10
