"""What every model of a kind of actuator must keep: a contract suite, run by pytest.

A model of someone else's is tested by a class of theirs::

    from ematwin.testing.model_contract import ModelContract

    class TestMyModel(ModelContract):
        @pytest.fixture
        def model(self):
            return MODEL

Each test fails with a sentence that says what to do. docs/your-own-model.md leads through the
making of a model.
"""

import math
import pickle
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from ematwin.errors import EmatwinError, InputError, ParameterError, RecordError
from ematwin.estimation.constants import FALSE_ALARM_RATE, LEVEL
from ematwin.estimation.search import named
from ematwin.models.base import Model
from ematwin.models.comparison import Comparison
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.reading import read, write
from ematwin.models.registry import load_actuator, model_of
from ematwin.models.simulating import simulate
from ematwin.models.unknown import Unknown
from ematwin.monitoring.identify import identify
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

PERFECT = Noise()  # a sensor without noise, where a kind would otherwise add that of a usual rig
_SEEN = 1e-3  # share of the whole signal by which a fault must at least move it
_SENSORS = 0.01  # noise of a usual sensor as a share of a channel's RMS about its mean
_DRAWS = 20  # tries to find a unit whose parameters allow one another
_CHANCE = 1e-3  # that a kind which keeps its word fails
_ALIKE = 1e-9  # of the largest value: one candidate in a batch and alone


class ModelContract:
    """Subclass it and give a fixture ``model``; loosen a bound only where the physics asks for it.

    Attributes
    ----------
    healthy_misfit : relative misfit of the healthy twin to a healthy simulation; more than 0 where
        the kind simulates with another model than its twin
    severity : fault that is put in, as a share of the way from healthy to the further bound
    recovered_within : how near `identify` comes to it, as a share of the range
    step : place of the step of the twin, such as ``steps.twin``, or None if it has none
    convergence : relative misfit of the twin to itself with half the step
    units : how many actuators within the stated tolerances are judged by the data sheet, half of
        them faulty; 0 where that takes too long
    thinned : relative difference of costs and sums of squared residuals; more than 0 where only
        some samples of a long answer are residuals
    """

    healthy_misfit: ClassVar[float] = 1e-6
    severity: ClassVar[float] = 0.3
    recovered_within: ClassVar[float] = 0.05
    step: ClassVar[str | None] = None
    convergence: ClassVar[float] = 0.02
    thinned: ClassVar[float] = 0.0
    units: ClassVar[int] = 16

    # What is tested

    @pytest.fixture
    def model(self) -> Model:
        """The model; a subclass gives it."""
        raise NotImplementedError(
            "Give your subclass of ModelContract a fixture `model` that returns the model."
        )

    @pytest.fixture
    def actuator(self, model: Model) -> ParameterSet:
        """The default parameter set."""
        return model.parameters.load()

    @pytest.fixture
    def healthy(self, model: Model, actuator: ParameterSet) -> Recording:
        """A healthy simulation of the default scenario."""
        return _simulated(model, actuator, {})

    @pytest.fixture
    def comparison(self, model: Model, actuator: ParameterSet, healthy: Recording) -> Comparison:
        """The healthy recording beside the twin."""
        return model.compare(healthy, actuator)

    # Parameters

    def test_it_says_what_it_is(self, model: Model) -> None:
        """Kind, title, parameters, channels and command have no default."""
        for name in ("kind", "title", "parameters", "channels", "command"):
            assert getattr(model, name, None), f"set {name} in the class of the model"

    def test_the_kind_is_found_by_its_name(self, model: Model) -> None:
        """Installed, and named alike by model, parameters and files."""
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

    def test_shipped_sets_load_with_units_and_sources(
        self, model: Model, actuator: ParameterSet
    ) -> None:
        """Each parameter has an SI unit, a meaning, and a source in the file."""
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

    def test_a_saved_set_is_the_same_actuator(
        self, model: Model, actuator: ParameterSet, tmp_path: Path
    ) -> None:
        """Written as a file and read again it has the same fingerprint."""
        actuator.save(tmp_path / "same.toml")
        assert load_actuator(tmp_path / "same.toml").fingerprint == actuator.fingerprint

    def test_nominal_parameters_can_be_searched(self, model: Model, actuator: ParameterSet) -> None:
        """Each place of ``nominal`` is there, has room between its limits, and a prior."""
        assert not set(model.nominal) & set(model.fixed), "what is fixed cannot be nominal"
        for place, factor in model.nominal.items():
            assert factor > 1.0, f"nominal {place}: a factor above 1 is needed, it is {factor:g}"
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

    def test_scenarios_are_shipped_and_followed(self, model: Model, actuator: ParameterSet) -> None:
        """Each loads in the units of the kind, and the simulation of it has its command."""
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

    def test_a_recording_without_a_needed_channel_is_refused(
        self, model: Model, actuator: ParameterSet, healthy: Recording
    ) -> None:
        """In one sentence that names the channel."""
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

    def test_unknowns_have_names_bounds_and_meanings(
        self, model: Model, actuator: ParameterSet
    ) -> None:
        """Names are unique and no place of a parameter; a direction has its magnitude."""
        unknowns = model.unknowns(actuator)
        names = [one.name for one in unknowns]
        assert len(set(names)) == len(names), f"a name comes twice: {', '.join(names)}"
        assert model.faults(actuator), "there is no unknown with the role 'fault' to identify"
        for one in unknowns:
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
        if model.covariate is not None:
            assert model.unknown(actuator, model.covariate).role == "nuisance"

    def test_values_are_described_with_units(self, model: Model, actuator: ParameterSet) -> None:
        """Healthy and faulty values have a finite physical value in a known unit."""
        for share in (0.0, 0.5, 1.0):
            values = {one.name: _towards(one, share) for one in model.unknowns(actuator)}
            rows = model.describe(actuator, values)
            assert {row.name for row in rows} <= set(values)
            assert {one.name for one in model.faults(actuator)} <= {row.name for row in rows}
            for row in rows:
                assert math.isfinite(row.value), f"{row.name}: {row.value} is no physical value"
                assert math.isfinite(row.healthy)
                assert _in_si(row.unit) > 0.0

    def test_reported_quantities_are_named_once(self, model: Model, actuator: ParameterSet) -> None:
        """A healthy population reports something, and each name once."""
        names = [one.name for one in model.reported(actuator)]
        assert names, "`reported` must name at least one quantity"
        assert len(set(names)) == len(names)

    def test_cases_of_a_study_lie_within_the_bounds(
        self, model: Model, actuator: ParameterSet
    ) -> None:
        """And the error of the truth is zero, that of healthy is not."""
        nothing = model.healthy(actuator)
        faults, study = model.faults(actuator), model.study
        for values in study.cases(faults).values():
            injected = model.values_of(actuator, values)
            assert study.error_percent(faults, injected, injected) == 0.0
            assert study.error_percent(faults, nothing, injected) > 0.0

    def test_the_default_search_is_known(self, model: Model) -> None:
        """By a name of ``ematwin algorithms``."""
        assert named(model.default_search).planned > 0

    # The twin

    def test_simulating_is_repeatable(self, model: Model, actuator: ParameterSet) -> None:
        """A seed gives the same recording bit for bit, another seed another one."""
        noisy = Noise(white=0.02)
        one, two, other = (
            simulate(None, None, None, actuator, noise=noisy, seed=seed) for seed in (1, 1, 2)
        )
        assert one.channels, "the simulation has no channels"
        for name, values in one.channels.items():
            np.testing.assert_array_equal(values, two.channels[name])
        if "A" in {channel.unit for channel in model.channels}:
            assert not all(np.array_equal(v, other.channels[n]) for n, v in one.channels.items()), (
                "noise changes nothing: give the recording that `simulate` returns its units"
            )

    def test_the_healthy_twin_reproduces_the_healthy_actuator(self, comparison: Comparison) -> None:
        """With no candidate value named at all, since what is not named is healthy."""
        misfit = math.sqrt(float(comparison.costs({}, 1)[0]) / comparison.scale)
        assert misfit <= self.healthy_misfit, (
            f"relative misfit {misfit:.2g}: values that are not named must be healthy, and the "
            "first state that of the recording"
        )

    def test_every_compared_channel_has_a_row_for_each_candidate(
        self, model: Model, actuator: ParameterSet, comparison: Comparison
    ) -> None:
        """Shape (B, S), float64, and residuals (B, K)."""
        count = 3
        candidates = _candidates(model, actuator, count)
        measured = comparison.measured()
        responses = comparison.responses(candidates, count)
        assert set(responses) == set(measured)
        for name, trace in responses.items():
            assert trace.shape == (count, measured[name].size), (
                f"{name} has shape {trace.shape} where {(count, measured[name].size)} is needed"
            )
            assert trace.dtype == np.float64
        residuals = comparison.residuals(candidates, count)
        assert residuals.ndim == 2
        assert residuals.shape[0] == count
        np.testing.assert_allclose(
            comparison.costs(candidates, count), (residuals**2).sum(1), rtol=1e-9 + self.thinned
        )

    def test_a_batch_equals_its_candidates_one_by_one(
        self, model: Model, actuator: ParameterSet, comparison: Comparison
    ) -> None:
        """Whichever neighbours a candidate has."""
        count = 7
        candidates = _candidates(model, actuator, count)
        together = comparison.residuals(candidates, count)
        for n in range(count):
            alone = comparison.residuals({k: v[n : n + 1] for k, v in candidates.items()}, 1)
            _assert_alike(together[n], alone[0], "differs when it is simulated alone")

    def test_a_candidate_that_is_not_a_number_says_so(
        self, model: Model, actuator: ParameterSet, comparison: Comparison
    ) -> None:
        """NaN in any value gives no finite cost, and leaves the neighbours as they were."""
        count = 5
        good = _candidates(model, actuator, count)
        expected = comparison.costs(good, count)
        for name in good.keys() - comparison.ignores:
            values = {k: v.copy() for k, v in good.items()}
            values[name][2] = math.nan
            costs = comparison.costs(values, count)
            assert not math.isfinite(costs[2]), (
                f"{name} = NaN costs {costs[2]:.3g}: set the traces of candidates that are not "
                "finite to NaN"
            )
            rest = np.arange(count) != 2
            _assert_alike(costs[rest], expected[rest], f"changes with a neighbour's {name} = NaN")

    def test_the_corners_of_the_box_do_no_harm(
        self, model: Model, actuator: ParameterSet, comparison: Comparison
    ) -> None:
        """A candidate that diverges costs infinity, and leaves the neighbours as they were."""
        searched = _searched(model, actuator)
        corners = np.array(
            [[one.lower if n >> k & 1 else one.upper for k, one in enumerate(searched)]
             for n in range(2 ** min(len(searched), 5))]
        )  # fmt: skip
        healthy = np.array([one.healthy for one in searched])
        rows = np.concatenate([healthy[None], corners, healthy[None]])
        costs = comparison.costs(_by_name(searched, rows), len(rows))
        assert not np.isnan(costs).any(), "a candidate that diverges must cost infinity, not NaN"
        _assert_alike(costs[[0, -1]], comparison.costs({}, 1)[[0, 0]], "changes in bad company")

    def test_parameters_differ_between_candidates(
        self, model: Model, actuator: ParameterSet, healthy: Recording, comparison: Comparison
    ) -> None:
        """Exactly as they differ between actuators; what is not `nominal` may be refused."""
        varied = 0
        for place, value, _, _, _ in actuator.parameters():
            changed = value * (0.5 if place == self.step else 1.03)
            try:
                other = actuator.changed({place: changed})
            except ParameterError:
                continue  # the other parameters do not allow it
            if place in model.fixed or changed == value:
                continue
            # an unknown's healthy value may depend on the parameter: give that of each actuator
            own, theirs = _held(model, actuator), _held(model, other)
            candidates = {name: np.array([own[name], theirs[name]]) for name in own}
            candidates[place] = np.array([value, changed])
            try:
                together = comparison.responses(candidates, 2)
            except InputError:
                if place in model.nominal:
                    raise
                continue
            apart = model.compare(healthy, other).responses({}, 1)
            for name, trace in apart.items():
                _assert_alike(
                    together[name][1], trace[0],
                    f"differs in {name} from an actuator with another {place}: take the parameters "
                    "from actuator.with_arrays, or list the place in `fixed`",
                )  # fmt: skip
            varied += 1
        assert varied, "no parameter of the actuator can differ between candidates"

    def test_each_fault_can_be_seen(
        self, model: Model, actuator: ParameterSet, comparison: Comparison
    ) -> None:
        """On the default scenario it moves some compared channel."""
        before = comparison.residuals({}, 1)[0]
        for one in _magnitudes(model, actuator):
            values = {one.name: np.array([_towards(one, 0.5)])}
            after = comparison.residuals(values, 1)[0]
            moved = math.sqrt(float(((after - before) ** 2).sum()) / comparison.scale)
            assert moved >= _SEEN, (
                f"{one.name} moves the default scenario by {100.0 * moved:.2g} % only: command "
                "more motion, or leave the fault out"
            )

    def test_a_shorter_step_changes_little(
        self, model: Model, actuator: ParameterSet, healthy: Recording
    ) -> None:
        """Halving it changes the answer, and halving it again changes it less."""
        if self.step is None:
            pytest.skip("no step is named")
        value = actuator.value(self.step)
        traces = [
            model.compare(healthy, actuator.changed({self.step: value / n})).residuals({}, 1)[0]
            for n in (1, 2, 4)
        ]
        scale = model.compare(healthy, actuator).scale
        first, second = (
            math.sqrt(float(((a - b) ** 2).sum()) / scale) for a, b in pairwise(traces)
        )
        assert first <= self.convergence, (
            f"half the step changes the answer by {100.0 * first:.2g} %: shorten {self.step}"
        )
        assert second < first or second < 1e-9, "a shorter step does not converge"

    # From a recording to a fault

    def test_each_fault_is_found_again(
        self, model: Model, actuator: ParameterSet, tmp_path: Path
    ) -> None:
        """Simulated, written to a file, read, and identified with all others free."""
        for one in _magnitudes(model, actuator):
            injected = _towards(one, self.severity)
            path = tmp_path / f"{one.name}.parquet"
            write(_simulated(model, actuator, {one.name: injected}), path)
            recording = read(path, actuator=actuator)
            found = identify(recording, actuator, exact=True)
            gap = abs(found.values[one.name] - injected) / one.width
            assert gap <= self.recovered_within, (
                f"{one.name} = {injected:.3g} is found as {found.values[one.name]:.3g} by "
                f"{found.algorithm} (misfit {100.0 * found.relative_misfit:.2g} %)"
            )
            assert one.name in found.present, f"{one.name} = {injected:.3g} is not called a fault"
            again = pickle.loads(pickle.dumps(found))
            assert again.values == found.values

    def test_a_healthy_recording_shows_no_fault(
        self, model: Model, actuator: ParameterSet, healthy: Recording
    ) -> None:
        """With all unknowns free."""
        found = identify(healthy, actuator, exact=True)
        assert found.present == (), f"{', '.join(found.present)} in a healthy recording"

    def test_units_within_their_tolerances_are_judged_honestly(
        self, model: Model, actuator: ParameterSet
    ) -> None:
        """No two units are alike, and their sensors have noise: wrong names and coverage, counted.

        Each parameter is off by what its tolerance says, each nuisance by its prior. Half of the
        units are healthy, the others have one fault each. A fault that is not there may be named
        on as many as `FALSE_ALARM_RATE` lets expect, and intervals may miss as often as 95 % ones
        do, with what chance adds once in a thousand cases. A recording that the kind refuses, as
        that of a drive that a fault has made unstable, says nothing; most must be judged.
        """
        if not self.units:
            pytest.skip("units take too long; count them elsewhere")
        wrong, missed, intervals, said, refused = 0, 0, 0, [], []
        for n in range(self.units):
            random = np.random.default_rng(n)
            unit = _unit_of(model, actuator, random)
            magnitudes = _magnitudes(model, unit)
            fault = {} if n % 2 else _one_fault(magnitudes[n // 2 % len(magnitudes)], random)
            recording = _simulated(model, unit, {**_by_chance(model, unit, random), **fault})
            try:
                found = identify(_with_noise(model, recording, random), actuator)
            except RecordError as refusal:
                refused.append(str(refusal))
                continue
            names = set(found.present) - set(fault)
            wrong += bool(names)
            said += [f"{', '.join(sorted(names))} on unit {n}"] if names else []
            for one in magnitudes:
                low, high = found.intervals[one.name]
                edge = 1e-6 * one.width
                missed += not low - edge <= fault.get(one.name, one.healthy) <= high + edge
                intervals += 1
        assert len(refused) < self.units / 2, (
            f"{len(refused)} of {self.units} units are refused: {refused[0]}"
        )
        most = _at_most(self.units, FALSE_ALARM_RATE)
        assert wrong <= most, (
            f"a fault that is not there is named on {wrong} of {self.units} units, and {most} may "
            f"be ({'; '.join(said)}): check that `nominal`, tolerances and priors of nuisances say "
            "how far units differ, that `fixed` holds none of these, and that `aliases` are right"
        )
        most = _at_most(intervals, 1.0 - LEVEL)
        assert missed <= most, (
            f"{missed} of {intervals} intervals of 95 % miss the true value, and {most} may: check "
            "`noise` and `model_error`, tolerances, and that `aliases` are right"
        )

    def test_recordings_sum_up_and_show(
        self, model: Model, actuator: ParameterSet, healthy: Recording
    ) -> None:
        """Reports have numbers and panels to print."""
        assert all(math.isfinite(value) for value in model.summary(healthy, actuator).values())
        signals = model.signals(healthy, actuator)
        assert signals
        for signal in signals:
            assert signal.title
            assert np.shape(signal.values) == healthy.time.shape

    def test_it_travels_between_processes(
        self, model: Model, actuator: ParameterSet, healthy: Recording
    ) -> None:
        """Model, actuator and recording pickle: studies run in several processes."""
        assert type(pickle.loads(pickle.dumps(model))) is type(model)
        assert pickle.loads(pickle.dumps(actuator)).fingerprint == actuator.fingerprint
        assert pickle.loads(pickle.dumps(healthy)).provenance == healthy.provenance


@cache
def _units() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


def _in_si(unit: str) -> float:
    """What one of a unit is in SI."""
    try:
        return float(_units().Quantity(1.0, unit).to_base_units().magnitude)
    except Exception as error:  # pint raises a family of unrelated types
        raise AssertionError(f"there is no unit {unit!r} ({error}); correct it") from None


def _simulated(model: Model, actuator: ParameterSet, values: Mapping[str, float]) -> Recording:
    return simulate(None, None, dict(values), actuator, noise=PERFECT)


def _searched(model: Model, actuator: ParameterSet) -> list[Unknown]:
    return [one for one in model.unknowns(actuator) if one.role in ("fault", "nuisance")]


def _magnitudes(model: Model, actuator: ParameterSet) -> list[Unknown]:
    return [one for one in model.faults(actuator) if one.direction_of is None]


def _held(model: Model, actuator: ParameterSet) -> dict[str, float]:
    return {one.name: one.healthy for one in _searched(model, actuator)}


def _towards(one: Unknown, share: float) -> float:
    """A value that lies a share of the way from healthy to the further bound."""
    up = one.upper - one.healthy >= one.healthy - one.lower
    return one.healthy + share * ((one.upper if up else one.lower) - one.healthy)


def _candidates(model: Model, actuator: ParameterSet, count: int) -> dict[str, np.ndarray]:
    """Values (B,) of all searched unknowns, the first healthy, the others near by."""
    searched = _searched(model, actuator)
    random = np.random.default_rng(1)
    shares = 0.2 * random.random((count, len(searched)))
    shares[0] = 0.0
    rows = np.array([[_towards(one, s) for one, s in zip(searched, row, strict=True)]
                     for row in shares])  # fmt: skip
    return _by_name(searched, rows)


def _unit_of(model: Model, actuator: ParameterSet, random: np.random.Generator) -> ParameterSet:
    """An actuator of which each parameter is off by what is stated of it."""
    drawn = {}
    for place, value, *_ in actuator.parameters():
        tolerance = actuator.tolerance(place)
        # as `uncertain` has it, but for what a kind leaves out by mistake
        factor = model.nominal.get(place) if tolerance is None else math.sqrt(1.0 + tolerance)
        if factor is not None and value > 0.0:
            drawn[place] = value * factor ** random.standard_normal()
    for _ in range(_DRAWS):
        limited = {place: float(np.clip(x, *actuator.limits(place))) for place, x in drawn.items()}
        try:
            return actuator.changed(limited)
        except ParameterError:  # the parameters do not allow one another: a unit nearer to nominal
            drawn = {p: math.sqrt(x * actuator.value(p)) for p, x in drawn.items()}
    return actuator


def _one_fault(one: Unknown, random: np.random.Generator) -> dict[str, float]:
    return {one.name: _towards(one, random.uniform(0.3, 0.7))}


def _by_chance(
    model: Model, actuator: ParameterSet, random: np.random.Generator
) -> dict[str, float]:
    """Nuisances as their priors have them."""
    found = {}
    for one in model.unknowns(actuator):
        if one.role == "nuisance" and one.spread is not None:
            off = one.spread * random.standard_normal()
            value = one.healthy * math.exp(off) if one.logarithmic else one.healthy + off
            found[one.name] = float(np.clip(value, one.lower, one.upper))
    return found


def _with_noise(model: Model, recording: Recording, random: np.random.Generator) -> Recording:
    """The recording with the white noise of usual sensors on what is compared."""
    noisy = {}
    for name in model.outputs:
        values = recording.channels.get(name)
        if values is not None:
            noise = _SENSORS * float(values.std()) * random.standard_normal(len(values))
            noisy[name] = values + noise
    return recording.changed(**noisy)


def _at_most(count: int, rate: float) -> int:
    """What a binomial number exceeds once in a thousand cases."""
    chances = [
        math.comb(count, k) * rate**k * (1.0 - rate) ** (count - k) for k in range(count + 1)
    ]
    return int(np.searchsorted(np.cumsum(chances), 1.0 - _CHANCE))


def _by_name(unknowns: list[Unknown], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {one.name: rows[:, n].copy() for n, one in enumerate(unknowns)}


def _assert_alike(one: np.ndarray, other: np.ndarray, what: str) -> None:
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    scale = float(np.abs(other[np.isfinite(other)]).max(initial=0.0))
    gap = float(np.abs(one - other).max()) if one.size else 0.0
    assert gap <= _ALIKE * max(scale, 1.0), f"it {what} (by {gap:.2g})"
