"""Presets name methods that are there, and every form says what it owes to whom."""

import pytest

from ematwin.errors import InputError
from ematwin.estimation.search import expanded, methods
from ematwin.optimizers import algorithms, create
from ematwin.optimizers.base import Box
from ematwin.optimizers.differential_evolution import Rand1
from ematwin.optimizers.genetic_algorithm import Binary
from ematwin.optimizers.genetic_operators import Roulette
from ematwin.optimizers.particle_swarm import Global
from ematwin.optimizers.registry import PRESETS

BOX = Box([0.0, 0.0], [1.0, 1.0])
KNOWN = {one.name: one for one in methods()}


def test_presets_hold_methods_that_can_be_named():
    for names in PRESETS.values():
        assert set(names) <= set(KNOWN)
    assert len(PRESETS["paper"]) == len(PRESETS["improved"]) == 6


def test_presets_and_names_are_expanded_each_method_once():
    assert expanded(["paper", "gwo", " BEST", "lm"]) == (
        *PRESETS["paper"], *PRESETS["best"], "levenberg-marquardt"
    )  # fmt: skip
    with pytest.raises(InputError, match="no algorithm 'papers'"):
        expanded(["papers"])


def test_every_method_of_this_package_says_its_source_departures_and_tuning():
    for one in algorithms():
        assert one.source
        assert one.departures not in ("", "not checked"), one.name
        assert one.tuned_on not in ("", "not known"), one.name


def test_the_paper_preset_is_tuned_on_nothing_and_the_improved_one_on_one_thing():
    assert {KNOWN[name].tuned_on for name in PRESETS["paper"]} == {"nothing: settings as published"}
    (tuned,) = {KNOWN[name].tuned_on for name in PRESETS["improved"]}
    assert "benchmarks/tuning.py" in tuned


def test_the_paper_preset_has_the_published_forms():
    ga, pso, de = (create(name, BOX) for name in ("ga-holland", "pso-inertia", "de-rand"))
    encoding, strategy = ga.encoding, de.strategy
    assert isinstance(encoding, Binary)
    assert (encoding.gray, encoding.crossed, encoding.flipped) == (False, 0.6, 0.001)
    assert isinstance(ga.selection, Roulette)
    assert not ga.elitist
    assert isinstance(pso.topology, Global)
    assert pso.craziness is None
    assert isinstance(strategy, Rand1)
    assert (de.F, de.CR) == (0.5, 0.9)
