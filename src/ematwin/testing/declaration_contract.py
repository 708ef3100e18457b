"""Declarations of a kind of actuator: parameters, channels, scenarios and unknowns.

The part of `ematwin.testing.model_contract.ModelContract` that simulates hardly anything.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from ematwin.errors import EmatwinError, ParameterError
from ematwin.estimation.search import named
from ematwin.models.base import Model
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.simulating import simulate
from ematwin.quantities import base_units, to_si
from ematwin.testing.draws import PERFECT, Bench, towards


class DeclarationContract:
    """A subclass gives a fixture ``model``."""

    @pytest.fixture
    def model(self) -> Model:
        raise NotImplementedError(
            "Give your subclass of ModelContract a fixture `model` that returns the model."
        )

    @pytest.fixture
    def actuator(self, model: Model) -> ParameterSet:
        return model.parameters.load()

    @pytest.fixture
    def bench(self, model: Model, actuator: ParameterSet) -> Bench:
        return Bench(model, actuator)

    # Parameters

    def test_it_says_what_it_is(self, model: Model) -> None:
        for name in ("kind", "title", "parameters", "channels", "command"):
            assert getattr(model, name, None), f"set {name} in the class of the model"

    def test_the_kind_is_found_by_its_name(self, model: Model) -> None:
        assert model.kind == model.parameters.kind, (
            f"the model says kind {model.kind!r}, its parameters {model.parameters.kind!r}; name "
            "them alike"
        )
        try:
            found = model_of(model.kind)
        except ParameterError as error:
            raise AssertionError(
                f"{error} Name the model in the entry point group ematwin.models of your "
                "pyproject.toml, and install the package again."
            ) from None
        assert type(found) is type(model), (
            f"the kind {model.kind!r} is that of {type(found).__module__}; choose another name"
        )

    def test_shipped_sets_load_with_units_and_sources(self, bench: Bench) -> None:
        model, actuator = bench.model, bench.actuator
        sets = {name: load_actuator(name) for name in model.parameters.shipped()}
        if model.parameters.own_model is not None:  # a file states the kind, and is all there is
            sets = {actuator.name: actuator}
        elif model.parameters.default not in sets:
            raise AssertionError(
                f"the default set {model.parameters.default!r} is not among the TOML files beside "
                f"{model.parameters.__module__} ({', '.join(sets) or 'there are none'})"
            )
        for name, actuator in sets.items():
            assert actuator.kind == model.kind, f"{name} loads as {actuator.kind}: names clash"
            assert actuator.name == name, f"{name}.toml says name = {actuator.name!r}"
            assert actuator.description, f"{name} needs a description"
            for place, value, unit, meaning, source in actuator.parameters():
                assert math.isfinite(value), f"{place} of {name} is not finite"
                assert _in_si(unit) == 1.0, f"the unit {unit!r} of {place} is not SI"
                assert meaning, f"{place} needs a meaning: quantity(unit, meaning)"
                assert source != "set by the user", f"{place} of {name} has no source"

    def test_a_saved_set_is_the_same_actuator(self, bench: Bench, tmp_path: Path) -> None:
        actuator = bench.actuator
        actuator.save(tmp_path / "same.toml")
        assert load_actuator(tmp_path / "same.toml").fingerprint == actuator.fingerprint

    def test_nominal_parameters_can_be_searched(self, bench: Bench) -> None:
        """Each place of ``nominal`` is there, has room between its limits, and a prior.

        Those of a section that the actuator leaves out are not.
        """
        model, actuator = bench.model, bench.actuator
        assert not set(model.nominal) & set(model.fixed), "what is fixed cannot be nominal"
        for place, factor in model.nominal.items():
            assert factor > 1.0, f"nominal {place}: a factor above 1 is needed, it is {factor:g}"
            if getattr(actuator, place.partition(".")[0], place) is None:
                continue
            one = model.unknown(actuator, place)
            assert one.role == "nominal"
            assert one.spread is not None, f"nominal {place} must be positive: it is a factor"

    # Channels and scenarios

    def test_channels_are_named_once_and_have_units(self, model: Model) -> None:
        """No name or alias means two channels; command, load and needs are among them."""
        seen: dict[str, str] = {}
        for channel in model.channels:
            assert _in_si(channel.unit) == 1.0, (
                f"the unit {channel.unit!r} of channel {channel.name} is not SI"
            )
            assert channel.meaning, f"channel {channel.name} needs a meaning"
            for name in (channel.name, *channel.aliases):
                assert name not in seen, f"{name!r} means both {seen[name]} and {channel.name}"
                assert name == name.casefold().replace(" ", "_"), (
                    f"{name!r} must be lower case with underscores; files may write it as they like"
                )
                seen[name] = channel.name
        known = {channel.name for channel in model.channels}
        wanted = {name for need in model.required for group in need for name in group}
        if model.load is not None:
            wanted.add(model.load)
        assert wanted <= known, f"channels lack {', '.join(sorted(wanted - known))}"
        assert model.outputs, "no channel is left to compare: all are inputs"

    def test_scenarios_are_shipped_and_followed(self, bench: Bench) -> None:
        """Each loads in the units of the kind, and the simulation of it has its command."""
        model, actuator = bench.model, bench.actuator
        assert model.scenarios(), (
            "there is no scenario: put a TOML file into a folder `scenarios` beside the model, "
            "so that simulate and compare have something to do"
        )
        for name in model.scenarios():
            scenario = model.load_scenario(name)
            model.check_scenario(scenario, actuator)
            recording = simulate(None, scenario, None, actuator, noise=PERFECT)
            command, _ = scenario.histories(recording.time)
            np.testing.assert_allclose(recording.channels[model.command], command, atol=1e-12)
            for output in model.outputs:
                if output in recording.channels:
                    assert np.isfinite(recording.channels[output]).all()

    def test_a_recording_without_a_needed_channel_is_refused(self, bench: Bench) -> None:
        model, actuator, healthy = bench.model, bench.actuator, bench.healthy
        for alternatives in model.required:
            names = [name for group in alternatives for name in group]
            with pytest.raises(EmatwinError) as caught:
                model.compare(healthy.changed(**dict.fromkeys(names)), actuator)
            said = str(caught.value)
            assert names[0] in said, f"the message must name {names[0]!r}: {said}"
            assert "\n" not in said
        with pytest.raises(EmatwinError):
            model.compare(healthy.changed(**dict.fromkeys(model.outputs)), actuator)

    # Unknowns

    def test_unknowns_have_names_bounds_and_meanings(self, bench: Bench) -> None:
        """Names are unique and no place of a parameter; a direction has its magnitude."""
        model, actuator = bench.model, bench.actuator
        names = [one.name for one in bench.unknowns]
        assert len(set(names)) == len(names), f"a name comes twice: {', '.join(names)}"
        assert model.faults(actuator), "there is no unknown with the role 'fault' to identify"
        for one in bench.unknowns:
            assert "." not in one.name, f"{one.name}: a name with a dot is the place of a parameter"
            assert one.meaning, f"{one.name} needs a meaning"
            assert one.lower <= one.healthy <= one.upper
            assert math.isfinite(one.width), f"{one.name} needs finite bounds"
            assert one.role != "nominal", (
                f"{one.name}: parameters of the actuator are unknowns by their place; list it in "
                "`nominal` instead"
            )
            if one.direction_of is not None:
                assert one.direction_of in names, f"{one.name}: no magnitude {one.direction_of}"
        judged = model.monitoring
        if judged is not None and judged.covariate is not None:
            assert model.unknown(actuator, judged.covariate).role == "nuisance"

    def test_values_are_described_with_units(self, bench: Bench) -> None:
        faults = {one.name for one in bench.model.faults(bench.actuator)}
        for share in (0.0, 0.5, 1.0):
            values = {one.name: towards(one, share) for one in bench.unknowns}
            rows = bench.model.describe(bench.actuator, values)
            assert faults <= {row.name for row in rows} <= set(values)
            for row in rows:
                assert math.isfinite(row.value), f"{row.name}: {row.value} is no physical value"
                assert math.isfinite(row.healthy)
                assert _in_si(row.unit) > 0.0

    def test_reported_quantities_are_named_once(self, model: Model, actuator: ParameterSet) -> None:
        if model.monitoring is None:
            return
        names = [one.name for one in model.monitoring.reported(model, actuator)]
        assert names, "`Monitoring.reported` must name at least one quantity"
        assert len(set(names)) == len(names)

    def test_cases_of_a_study_lie_within_the_bounds(self, bench: Bench) -> None:
        """And the error of the truth is zero, the error of healthy is not."""
        model, actuator = bench.model, bench.actuator
        nothing = model.healthy(actuator)
        faults, study = model.faults(actuator), model.study
        for values in study.cases(faults).values():
            injected = model.values_of(actuator, values)
            assert study.error_percent(faults, injected, injected) == 0.0
            assert study.error_percent(faults, nothing, injected) > 0.0

    def test_the_default_search_is_known(self, model: Model) -> None:
        assert named(model.default_search).planned > 0


def _in_si(unit: str) -> float:
    """Size of a unit in SI."""
    try:
        base = "*".join(f"{name}^{power}" for name, power in base_units(unit).items())
        return to_si(1.0, unit, base, "it")
    except Exception as error:  # pint raises a family of unrelated types
        raise AssertionError(f"there is no unit {unit!r} ({error}); correct it") from None
