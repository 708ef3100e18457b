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
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from ematwin.errors import InputError, ParameterError, RecordError
from ematwin.estimation.constants import FALSE_ALARM_RATE, LEVEL
from ematwin.models.reading import read, write
from ematwin.models.simulating import simulate
from ematwin.monitoring.identify import identify
from ematwin.recordings.noise import Noise
from ematwin.testing.declaration_contract import DeclarationContract
from ematwin.testing.draws import Bench, at_most, nuisances, towards


class ModelContract(DeclarationContract):
    """Subclass it and give a fixture ``model``; loosen a bound only where the physics asks for it.

    Attributes
    ----------
    healthy_misfit : relative misfit of the healthy twin to a healthy simulation; more than 0 where
        the kind simulates with another model than its twin
    severity : fault that is put in, as a share of the way from healthy to the further bound
    recovered_within : how near `identify` comes to it, as a share of the range
    step : place of the step of the twin, such as ``steps.twin``, or None if it has none
    convergence : relative misfit of the twin to itself with half the step
    of_noise : the same, RMS, in the unit of `Model.noise`, of kinds that are compared by it
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
    of_noise: ClassVar[float] = 0.3
    thinned: ClassVar[float] = 0.0
    units: ClassVar[int] = 16

    # The twin

    def test_simulating_is_repeatable(self, bench: Bench) -> None:
        noisy = Noise(white=0.02)
        one, two, other = (
            simulate(None, None, None, bench.actuator, noise=noisy, seed=seed) for seed in (1, 1, 2)
        )
        assert one.channels, "the simulation has no channels"
        for name, values in one.channels.items():
            np.testing.assert_array_equal(values, two.channels[name])
        if "A" in {channel.unit for channel in bench.model.channels}:
            assert not all(np.array_equal(v, other.channels[n]) for n, v in one.channels.items()), (
                "noise changes nothing: give the recording that `simulate` returns its units"
            )

    def test_the_healthy_twin_reproduces_the_healthy_actuator(self, bench: Bench) -> None:
        """With no candidate value named at all: all are healthy by default."""
        misfit = math.sqrt(float(bench.comparison.costs({}, 1)[0]) / bench.comparison.scale)
        assert misfit <= self.healthy_misfit, (
            f"relative misfit {misfit:.2g}: values that are not named must be healthy, and the "
            "first state that of the recording"
        )

    def test_every_compared_channel_has_a_row_for_each_candidate(self, bench: Bench) -> None:
        count, comparison = 3, bench.comparison
        candidates = bench.candidates(count)
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

    def test_a_batch_equals_its_candidates_one_by_one(self, bench: Bench) -> None:
        count, comparison = 7, bench.comparison
        candidates = bench.candidates(count)
        together = comparison.residuals(candidates, count)
        for n in range(count):
            alone = comparison.residuals({k: v[n : n + 1] for k, v in candidates.items()}, 1)
            _assert_alike(together[n], alone[0], "differs when it is simulated alone")

    def test_a_candidate_that_is_not_a_number_says_so(self, bench: Bench) -> None:
        """NaN in any value gives no finite cost, and leaves the neighbours as they were."""
        count, comparison = 5, bench.comparison
        good = bench.candidates(count)
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

    def test_the_corners_of_the_box_do_no_harm(self, bench: Bench) -> None:
        """A candidate that diverges costs infinity, and leaves the neighbours as they were."""
        comparison, count = bench.comparison, 2 ** min(len(bench.searched), 5)
        rows = {
            one.name: np.array([
                one.healthy,
                *(one.lower if n >> k & 1 else one.upper for n in range(count)),
                one.healthy,
            ])
            for k, one in enumerate(bench.searched)
        }  # fmt: skip
        costs = comparison.costs(rows, count + 2)
        assert not np.isnan(costs).any(), "a candidate that diverges must cost infinity, not NaN"
        _assert_alike(costs[[0, -1]], comparison.costs({}, 1)[[0, 0]], "changes in bad company")

    def test_parameters_differ_between_candidates(self, bench: Bench) -> None:
        """Exactly as they differ between actuators; others than `nominal` ones may be refused."""
        model, actuator, varied = bench.model, bench.actuator, 0
        for place, value, _, _, _ in actuator.parameters():
            changed = value * (0.5 if place == self.step else 1.03)
            try:
                other = actuator.changed({place: changed})
            except ParameterError:
                continue  # the other parameters do not allow it
            if place in model.fixed or changed == value:
                continue
            # an unknown's healthy value may depend on the parameter: give that of each actuator
            own, theirs = bench.held, Bench(model, other).held
            candidates = {name: np.array([own[name], theirs[name]]) for name in own}
            candidates[place] = np.array([value, changed])
            try:
                together = bench.comparison.responses(candidates, 2)
            except InputError:
                if place in model.nominal:
                    raise
                continue
            apart = model.compare(bench.healthy, other).responses({}, 1)
            for name, trace in apart.items():
                _assert_alike(
                    together[name][1], trace[0],
                    f"differs in {name} from an actuator with another {place}: take the parameters "
                    "from actuator.with_arrays, or list the place in `fixed`",
                )  # fmt: skip
            varied += 1
        assert varied, "no parameter of the actuator can differ between candidates"

    def test_each_fault_can_be_seen(self, bench: Bench) -> None:
        comparison = bench.comparison
        before = comparison.residuals({}, 1)[0]
        for one in bench.magnitudes:
            values = {one.name: np.array([towards(one, 0.5)])}
            after = comparison.residuals(values, 1)[0]
            moved = math.sqrt(float(((after - before) ** 2).sum()) / comparison.scale)
            assert moved >= 1e-3, (
                f"{one.name} moves the default scenario by {100.0 * moved:.2g} % only: command "
                "more motion, or leave the fault out"
            )

    def test_a_shorter_step_changes_little(self, bench: Bench) -> None:
        if self.step is None:
            pytest.skip("no step is named")
        value, traces = bench.actuator.value(self.step), []
        for n in (1, 2, 4):
            finer = bench.actuator.changed({self.step: value / n})
            traces.append(bench.model.compare(bench.healthy, finer).residuals({}, 1)[0])
        scale = bench.comparison.scale
        first, second = (
            math.sqrt(float(((a - b) ** 2).sum()) / scale) for a, b in pairwise(traces)
        )
        assert first <= self.convergence, (
            f"half the step changes the answer by {100.0 * first:.2g} %: shorten {self.step}"
        )
        assert second < first or second < 1e-9, "a shorter step does not converge"
        if bench.comparison.whitened:
            off = math.sqrt(float(np.mean((traces[0] - traces[1]) ** 2)))
            assert off <= self.of_noise, (
                f"half the step changes the answer by {off:.2g} of `noise`, which searches would "
                f"find instead of faults: shorten {self.step}"
            )

    # From a recording to a fault

    def test_each_fault_is_found_again(self, bench: Bench, tmp_path: Path) -> None:
        """Simulated, written to a file, read, and identified with all others free."""
        for one in bench.magnitudes:
            injected = towards(one, self.severity)
            path = tmp_path / f"{one.name}.parquet"
            write(bench.simulated(**{one.name: injected}), path)
            recording = read(path, actuator=bench.actuator)
            found = identify(recording, bench.actuator, exact=True)
            gap = abs(found.values[one.name] - injected) / one.width
            assert gap <= self.recovered_within, (
                f"{one.name} = {injected:.3g} is found as {found.values[one.name]:.3g} by "
                f"{found.algorithm} (misfit {100.0 * found.relative_misfit:.2g} %)"
            )
            assert one.name in found.present, f"{one.name} = {injected:.3g} is not called a fault"
            again = pickle.loads(pickle.dumps(found))
            assert again.values == found.values

    def test_a_healthy_recording_shows_no_fault(self, bench: Bench) -> None:
        found = identify(bench.healthy, bench.actuator, exact=True)
        assert found.present == (), f"{', '.join(found.present)} in a healthy recording"

    def test_units_within_their_tolerances_are_judged_honestly(self, bench: Bench) -> None:
        """No two units are alike, nor their sensors: wrong names and coverage, counted.

        Parameters are drawn within their tolerances, nuisances and sensors from their priors. Half
        of the units are healthy, the others have one fault each. A fault that is not there may be
        named on as many as `FALSE_ALARM_RATE` lets expect, and intervals may miss as often as 95 %
        ones do, with what chance adds once in a thousand cases. A recording that the kind refuses,
        as such as of a drive that a fault has made unstable, does not count; most must be judged.
        """
        if not self.units:
            pytest.skip("units take too long; count them elsewhere")
        wrong, missed, intervals, said, refused = 0, 0, 0, [], []
        for n in range(self.units):
            random = np.random.default_rng(n)
            unit, fault = bench.unit(random), dict[str, float]()
            if n % 2 == 0:
                worn = unit.magnitudes[n // 2 % len(unit.magnitudes)]
                fault = {worn.name: towards(worn, random.uniform(0.3, 0.7))}
            recording = unit.simulated(**{**nuisances(unit.unknowns, random), **fault})
            try:
                found = identify(unit.as_recorded(recording, random), bench.actuator)
            except RecordError as refusal:
                refused.append(str(refusal))
                continue
            names = set(found.present) - set(fault)
            wrong += bool(names)
            said += [f"{', '.join(sorted(names))} on unit {n}"] if names else []
            for one in unit.magnitudes:
                low, high = found.intervals[one.name]
                edge = 1e-6 * one.width
                missed += not low - edge <= fault.get(one.name, one.healthy) <= high + edge
                intervals += 1
        assert len(refused) < self.units / 2, (
            f"{len(refused)} of {self.units} units are refused: {refused[0]}"
        )
        most = at_most(self.units, FALSE_ALARM_RATE)
        assert wrong <= most, (
            f"a fault that is not there is named on {wrong} of {self.units} units, and {most} may "
            f"be ({'; '.join(said)}): check that `nominal`, tolerances and priors of nuisances say "
            "how far units differ, that `fixed` holds none of these, and that `aliases` are right"
        )
        most = at_most(intervals, 1.0 - LEVEL)
        assert missed <= most, (
            f"{missed} of {intervals} intervals of 95 % miss the true value, and {most} may: check "
            "`noise` and `model_error`, tolerances, and that `aliases` are right"
        )

    def test_recordings_sum_up_and_show(self, bench: Bench) -> None:
        model, actuator, healthy = bench.model, bench.actuator, bench.healthy
        assert all(math.isfinite(value) for value in model.summary(healthy, actuator).values())
        signals = model.signals(healthy, actuator)
        assert signals
        for signal in signals:
            assert signal.title
            assert np.shape(signal.values) == healthy.time.shape

    def test_it_travels_between_processes(self, bench: Bench) -> None:
        """Model, actuator and recording pickle: studies run in several processes."""
        model, actuator, healthy = bench.model, bench.actuator, bench.healthy
        assert type(pickle.loads(pickle.dumps(model))) is type(model)
        assert pickle.loads(pickle.dumps(actuator)).fingerprint == actuator.fingerprint
        assert pickle.loads(pickle.dumps(healthy)).provenance == healthy.provenance


def _assert_alike(one: np.ndarray, other: np.ndarray, what: str) -> None:
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    scale = float(np.abs(other[np.isfinite(other)]).max(initial=0.0))
    gap = float(np.abs(one - other).max()) if one.size else 0.0
    assert gap <= 1e-9 * max(scale, 1.0), f"it {what} (by {gap:.2g})"
