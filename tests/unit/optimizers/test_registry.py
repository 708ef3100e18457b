"""Names, presets, entry points, methods of others, missing libraries, and what importing costs."""

import numpy as np
import pytest

import ematwin
from commands import fresh
from ematwin.errors import InputError
from ematwin.estimation.search import expanded, methods
from ematwin.optimizers import Box, Optimizer, RandomSearch, Whale, algorithms, minimize
from ematwin.optimizers.differential_evolution import rand_1
from ematwin.optimizers.genetic_algorithm import Binary, Roulette
from ematwin.optimizers.particle_swarm import Global
from ematwin.optimizers.registry import PRESETS, find
from ematwin.testing.optimizer_contract import check_optimizer
from own_model import installed

BOX = Box([0.0, 0.0], [1.0, 1.0])
KNOWN = {one.name: one for one in methods()}


def made(name):
    return find(name).factory()(BOX, population=20, iterations=10, seed=1)


def test_every_name_and_alias_is_told_once_with_source_departures_and_tuning():
    names = [name for found in algorithms() for name in (found.name, *found.aliases)]
    assert len(names) == len(set(names))
    for one in algorithms():
        assert isinstance(made(one.name), Optimizer)
        assert one.title
        assert one.source
        assert one.departures not in ("", "not checked"), one.name
        assert one.tuned_on not in ("", "not known"), one.name


def test_aliases_and_spelling_lead_to_the_same_and_a_wrong_name_to_the_closest():
    assert find("CMA_ES").name == "cma"
    assert find(" Grey-Wolf ").name == "gwo"
    with pytest.raises(InputError, match=r"no algorithm 'wao'.*woa"):
        find("wao")


def test_presets_and_names_are_expanded_each_method_once():
    for names in PRESETS.values():
        assert set(names) <= set(KNOWN)
    assert expanded(["paper", "gwo", " BEST", "lm"]) == (
        *PRESETS["paper"], *PRESETS["best"], "levenberg-marquardt"
    )  # fmt: skip
    with pytest.raises(InputError, match="no algorithm 'papers'"):
        expanded(["papers"])


def test_the_paper_preset_has_the_published_forms():
    ga, pso, de = map(made, ("ga-holland", "pso-inertia", "de-rand"))
    assert ga.encoding == Binary(gray=False, crossed=0.6, flipped=0.001)
    assert isinstance(ga.selection, Roulette)
    assert not ga.elitist
    assert isinstance(pso.topology, Global)
    assert pso.crazy == 0.0
    assert (de.strategy, de.F, de.CR) == (rand_1, 0.5, 0.9)


# Methods of others


@pytest.fixture
def somebody(tmp_path, monkeypatch):
    """An installed package with three algorithms."""
    whale = "ematwin.optimizers:Whale"
    lines = f"mine = {whale}\ngwo = {whale}\nbroken = no_such_module:Nothing"
    installed(tmp_path, "somebody", optimizers=lines)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("somebody")
def test_an_entry_point_is_listed_run_and_never_takes_over_a_name():
    assert find("mine").origin == "somebody"
    assert find("gwo").origin == "ematwin"
    assert isinstance(made("somebody:gwo"), Whale)
    result = minimize(lambda p: (p**2).sum(axis=1), [0, 0], [1, 1], "mine", iterations=3)
    assert result.algorithm == "mine"
    with pytest.raises(InputError, match="'broken' cannot be loaded"):
        made("broken")


class Mine(RandomSearch):
    """Random search, renamed."""


class NoInit(Optimizer):
    """Its bases take no arguments."""

    def ask(self):
        return np.zeros((1, 3))

    def tell(self, points, costs): ...


class Flat(RandomSearch):
    """Asks for one point, not for a batch."""

    def ask(self):
        return super().ask()[0]


class Outside(RandomSearch):
    """Leaves the box."""

    def ask(self):
        return super().ask() + 100.0

    def tell(self, points, costs):
        super().tell(super().ask(), costs)


@pytest.mark.usefixtures("registrations")
def test_a_registered_name_is_used_like_any_other():
    ematwin.register("My_Search", Mine)
    assert find("my_search").title == "Random search, renamed"
    found, again = (
        minimize(lambda x: x @ x, [-1, -1], [1, 1], name, 10, 5) for name in ("my-search", "random")
    )
    assert (found.algorithm, found.cost) == ("my-search", again.cost)


@pytest.mark.parametrize(
    ("name", "factory", "said"),
    [
        ("gwo", Mine, "'gwo' is taken"),
        ("mine", 3, "function that makes one"),
        ("mine", NoInit, r"'mine' is called with .* TypeError: NoInit"),
        ("mine", Flat, r"of shape \(3,\)\. Correct its ask"),
        ("mine", Outside, "asked for points outside the box"),
        ("mine", lambda box, **given: dict(given), "Optimizer, but made dict"),
    ],
)
def test_what_cannot_search_is_refused_before_a_study_begins(name, factory, said):
    with pytest.raises(InputError, match=said):
        ematwin.register(name, factory)
    with pytest.raises(InputError, match="no algorithm 'mine'"):
        find("mine")


def test_the_contract_finds_a_method_that_breaks_it():
    with pytest.raises(AssertionError, match="outside the box"):
        check_optimizer(Outside)


def test_importing_the_optimisers_imports_no_other_library():
    code = (
        "import sys, ematwin.optimizers as o; o.algorithms();"
        "print([m for m in ('cma','pymoo','pygmo','nevergrad','scipy','pytest','numba') "
        "if m in sys.modules])"
    )
    assert fresh(code).out.strip() == "[]"
