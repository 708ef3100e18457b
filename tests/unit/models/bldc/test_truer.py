"""The truer forms step by step against plain Python, and what a batch makes of them."""

import numpy as np
import pytest

import ematwin
from bldc_inputs import ALL_FORMS, ENCODER, FORMS, HALF, SEVERE, history
from ematwin.errors import ParameterError
from ematwin.models.bldc import batch
from ematwin.models.bldc.constants import (
    Truer,
    fault_state,
    kernel_constants,
    truer_constants,
)
from ematwin.models.bldc.faults import Faults
from ematwin.models.bldc.inverter import advance_shorted_bridge
from ematwin.models.bldc.motor import truer_emf_constants
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.reference_step import (
    advance_current_loop,
    advance_speed_loop,
    last_reading,
)
from ematwin.models.registry import model_of
from ematwin.models.simulating import simulate
from ematwin.numerics.compile import plain
from naive import monitor as naive_monitor
from naive import truer as naive

PLAIN = BldcActuator.load()
LATE = {
    "speed_loop.integral_gain": 0.0, "speed_loop.sample_time": 5e-5, "speed_loop.delay": 0.0,
}  # fmt: skip
SLOW = {
    "current_loop.proportional_gain": 2.88, "current_loop.integral_gain": 8520.0,
    "current_loop.sample_time": 1e-4, "current_loop.delay": 1e-4,
    "current_loop.lost_voltage": 0.0,
}  # fmt: skip
TRUER = PLAIN.changed(ALL_FORMS)
MODEL = model_of(PLAIN)


LOOPS = PLAIN.changed(FORMS["shorted_turns"] | FORMS["eccentricity"])


def monitor_trace(faults, command, load, dt, actuator, substeps=1, state=None):
    return batch.monitor_trace(
        faults, command, load, np.zeros(7) if state is None else state, kernel_constants(actuator),
        dt, substeps, 1, None if actuator.shorted_turns is None else np.zeros(4),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("form", "same"), [("shorted_turns", 1500), ("eccentricity", 2000), ("both", 1100)]
)
def test_monitor_model_is_that_of_the_naive_loop(form, same):
    actuator = LOOPS if form == "both" else PLAIN.changed(FORMS[form])
    faults, dt, steps = Faults(**SEVERE), 1e-5, 2_000
    command, load = history(steps, dt)
    trace = monitor_trace(faults.vector, command, load, dt, actuator)
    command, load = (0.5 * (x[:-1] + x[1:]) for x in (command, load))  # of the middles
    naive_loop = naive_monitor.simulate if form == "eccentricity" else naive.simulate_monitor
    slow = naive_loop(actuator, faults, command, load, dt)
    assert np.ptp(slow["motor"]) > 2.0
    names = ("mean_current", "motor", "motor_speed", "output", "output_speed", "power")
    for column, name in enumerate(names):
        np.testing.assert_allclose(trace[:same, column], slow[name][:same], rtol=1e-7, atol=1e-7)
        # impacts of loops under overspeed amplify the last digit
        np.testing.assert_allclose(trace[:, column], slow[name], rtol=1e-2, atol=1e-2)


def test_rounded_emf_constants_are_those_of_the_naive_version():
    rng, faults = np.random.default_rng(8), Faults(**SEVERE)
    windings = naive.Windings(TRUER, faults)
    c, truer = kernel_constants(TRUER), truer_constants(TRUER)
    fault = plain(fault_state)(faults.vector, c.half_gap)
    for theta in rng.uniform(-10.0, 10.0, 50):
        found = plain(truer_emf_constants)(theta, windings.h, fault, c, truer)
        assert found == pytest.approx(windings.kappa(theta), abs=1e-10)


def test_sampled_loops_answer_as_the_naive_ones_do():
    rng, faults, dt = np.random.default_rng(9), Faults(gain=0.7), 1e-6
    c, truer = kernel_constants(TRUER), truer_constants(TRUER, 0.3)
    speed, current = naive.SpeedLoop(TRUER, faults, dt, 0.3), naive.CurrentLoop(TRUER, dt)
    asked, volts = (0.0,) * 5 + (plain(last_reading)(truer, 0.0, 0.0), 0.0), (0.0,) * 5
    steps = 2_000  # limits of current, voltage and speed among them
    inputs = np.repeat(rng.normal(size=(steps // 20, 5)) * [2, 0.01, 0.5, 100, 15], 20, axis=0)
    for command, angle, output, w_m, i in inputs:
        asked = plain(advance_speed_loop)(
            *asked, command, angle, output, w_m, c.k_position * 1.2, c, truer, dt
        )
        assert asked[0] == pytest.approx(speed.demand(command, output, w_m, angle), rel=1e-9)
        i_ref = min(max(asked[0], -c.i_max), c.i_max)
        volts = plain(advance_current_loop)(*volts, i_ref, i, c.v_supply, truer, dt)
        assert volts[0] == pytest.approx(current.answer(i_ref, i), rel=1e-9)


def test_bridge_with_shorted_turns_solves_the_equations_of_coupled_windings():
    rng, c, dt = np.random.default_rng(5), kernel_constants(TRUER), 1e-6
    for _ in range(20):
        faults = Faults(**dict(zip(("short_a", "short_b", "short_c"), rng.random(3), strict=True)))
        windings = naive.Windings(TRUER, faults)
        i_a, i_b = rng.uniform(1.0, 5.0, 2)
        currents = np.array([i_a, -i_a - i_b, i_b, *rng.uniform(-5.0, 5.0, 3)])
        kappa, w = windings.kappa(rng.uniform(0.0, 6.0)), rng.uniform(-500.0, 500.0)
        emf = windings.emf(kappa, w)
        # c is off, and its current flows on through the lower diode
        volts = np.array([c.v_supply, 0.0, -c.v_diode])
        expected = naive.advance_phases(windings, currents, volts, emf, dt)
        phases, loops, _, _, taken, _, _ = plain(advance_shorted_bridge)(
            currents[:3], currents[3:], emf[:3], (1.0, -1.0, 0.0), (1.0,) * 3, windings.mu, c, dt
        )
        found = [*phases, *loops]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        mean = 0.5 * (currents + expected)[:3]
        assert taken == pytest.approx(dt * volts @ mean, rel=1e-9)


@pytest.fixture(scope="module")
def comparison():
    record = simulate("reference", faults={"short_a": 0.15}, actuator=TRUER)
    return MODEL.compare(record, TRUER, threads=2)


VECTORS = 0.4 * np.random.default_rng(3).random((40, 8))
CANDIDATES = {one.name: VECTORS[:, n] for n, one in enumerate(MODEL.faults(PLAIN))}


def test_a_batch_answers_as_the_monitor_model_does_with_the_forms_that_it_has(comparison):
    answers = comparison.responses(CANDIDATES, len(VECTORS))["current"]
    for n in (0, 17):
        trace = monitor_trace(
            VECTORS[n], comparison.command, comparison.load, comparison.step, TRUER,
            comparison.substeps, comparison.state.copy(),
        )  # fmt: skip
        current = np.concatenate([[comparison.current[0]], trace[:, 0]])
        expected = comparison.low_pass.apply(current, comparison.recording.sample_rate)
        np.testing.assert_allclose(answers[n], expected, rtol=1e-9, atol=1e-9)


def test_costs_are_the_same_however_a_batch_is_run(comparison):
    costs = comparison.costs(CANDIDATES, len(VECTORS))
    assert np.isfinite(costs).all()
    residuals = comparison.residuals(CANDIDATES, len(VECTORS))
    np.testing.assert_allclose((residuals**2).sum(axis=1), costs, rtol=0.05)
    # with limits it runs in segments, and keeps the loops between them
    limits = np.where(np.arange(len(costs)) % 2, np.inf, np.median(costs))
    within = comparison.costs_within(CANDIDATES, len(VECTORS), limits)
    kept = np.isfinite(within)
    assert kept.any()
    assert not kept.all()
    np.testing.assert_array_equal(within[kept], costs[kept])
    # each candidate may have constants of its own
    places = "shorted_turns.resistance", "eccentricity.turning_share"
    own = {place: np.full(len(VECTORS), TRUER.value(place)) for place in places}
    np.testing.assert_allclose(
        comparison.costs({**CANDIDATES, **own}, len(VECTORS)), costs, rtol=1e-9
    )
    own["shorted_turns.resistance"][1] *= 1.5
    changed = comparison.costs({**CANDIDATES, **own}, len(VECTORS))
    assert changed[1] != pytest.approx(costs[1], rel=1e-3)
    assert changed[2] == pytest.approx(costs[2], rel=1e-9)
    own["shorted_turns.resistance"][2] = np.nan
    assert np.isposinf(comparison.costs({**CANDIDATES, **own}, len(VECTORS))[2])


@pytest.mark.parametrize("section", sorted(FORMS.keys() - {"shorted_turns", "eccentricity"}))
def test_a_form_of_the_reference_alone_changes_its_answer_and_not_that_of_the_lanes(section):
    record = simulate("reference", "step", sample_rate=5e3)
    with_it, without = (
        MODEL.compare(record, one) for one in (PLAIN.changed(FORMS[section]), PLAIN)
    )
    # a current loop has no comparator, whose ripple loosens static friction
    lanes = PLAIN.changed({"drive.hysteresis_band": 1e-9}) if section == "current_loop" else PLAIN
    costs = MODEL.compare(record, lanes).costs(CANDIDATES, len(VECTORS))
    place = next(iter(FORMS[section]))
    named = CANDIDATES | {place: np.linspace(0.5, 1.0, len(VECTORS)) * FORMS[section][place]}
    np.testing.assert_allclose(with_it.costs(CANDIDATES, len(VECTORS)), costs, rtol=1e-6)
    np.testing.assert_allclose(with_it.costs(named, len(VECTORS)), costs, rtol=1e-6)
    exact = [one.exact(one_set)["current"] for one, one_set in (
        (without, {}), (with_it, {}), (with_it, {place: 0.5 * FORMS[section][place]}),
    )]  # fmt: skip
    for n, other in ((0, 1), (1, 2)):
        assert np.abs(exact[n] - exact[other]).max() > 1e-3 * np.abs(exact[n]).max()


def test_a_modulated_drive_answers_alike_by_longer_steps():
    loops = ("speed_loop", "current_loop", "cogging")
    drive = PLAIN.changed({place: x for form in loops for place, x in FORMS[form].items()})
    record = simulate("reference", "default", actuator=drive, sample_rate=1e4)
    faults = {"friction": 0.3, "short_b": 0.1, "eccentricity": 0.2, "gain": 0.6}
    short, long = (
        MODEL.compare(record, one).exact(faults)["current"]
        for one in (drive.changed({"steps.reference": 0.25e-6}), drive)
    )
    assert 0.0 < np.sqrt(np.sum((long - short) ** 2) / np.sum(short**2)) < 0.002


def test_sections_that_are_left_out_leave_no_trace():
    assert truer_constants(PLAIN) == Truer()
    assert PLAIN.changed({"steps.monitor": 25 * 1e-6}).fingerprint == "28230fd0bc8ee55b"
    for form in (*FORMS.values(), ENCODER | FORMS["speed_loop"]):
        one = PLAIN.changed(form)
        assert one.fingerprint != PLAIN.fingerprint
        assert {place for place, *_ in one.parameters()} - {
            place for place, *_ in PLAIN.parameters()
        } == set(form)


def test_a_template_shows_what_is_left_out_as_comments_that_can_be_used(tmp_path):
    text = PLAIN.template()
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    assert BldcActuator.load(path).fingerprint == PLAIN.fingerprint
    head, _, options = text.partition("# Sections that may be left out")
    lines = [line.removeprefix("# ") for line in options.splitlines()]
    used = [x for x in lines if x.startswith("[") or " = {value" in x]
    path.write_text(head + "\n".join(used), encoding="utf-8")
    loaded = BldcActuator.load(path)
    assert all(getattr(loaded, section) is not None for section in FORMS)
    # and a file with all of them reads back as it is
    path.write_text(TRUER.template(), encoding="utf-8")
    assert BldcActuator.load(path).fingerprint == TRUER.fingerprint


@pytest.mark.parametrize(
    ("form", "said"),
    [
        ({"shorted_turns.resistance": 0.0}, "shorted_turns.resistance must be greater than 0"),
        (
            {"eccentricity.turning_share": 1.5},
            "eccentricity.turning_share must be less than or equal to 1",
        ),
        ({"cogging.torque": 0.1}, "cogging.cycles is missing"),
        (
            LATE | {"speed_loop.sample_time": 1.5e-4},
            "unstable at speed_loop.sample_time = 0.00015 s .* must be below 0.000101 s",
        ),
        (LATE | {"speed_loop.delay": 1e-4}, "delay must be at most sample_time, 5e-05 s"),
        (SLOW | {"current_loop.delay": 2e-4}, "delay must be at most sample_time, 0.0001 s"),
        (
            SLOW,
            "the speed loop is unstable with current_loop.sample_time = 0.0001 s .* "
            r"controller.speed_gain must be below 0\.012 ",
        ),
        (
            SLOW | {"current_loop.proportional_gain": 40.0},
            "the current loop is unstable with .*: sample faster or lower its gains",
        ),
        (SLOW | {"current_loop.proportional_gain": 0.0}, "must be greater than 0"),
        (ENCODER, "speed loop, which is continuous; state speed_loop.sample_time above 0"),
        (
            LATE | ENCODER | {"encoder.filter_time": 1e-3},
            "the speed loop is unstable at speed_loop.sample_time",
        ),
    ],
)
def test_impossible_values_are_refused(form, said):
    with pytest.raises(ParameterError, match=said):
        PLAIN.changed(form)


@pytest.mark.parametrize("resistance", [0.06, 0.17])
def test_a_contact_of_another_resistance_looks_like_other_turns(resistance):
    """Of a loop, currents show mu^2/(R_f + mu R) and no more; intervals know that."""
    true, guessed = (PLAIN.changed({"shorted_turns.resistance": r}) for r in (resistance, 0.1))
    record = simulate("reference", HALF, {"short_a": 0.15}, true)
    r = PLAIN.motor.resistance / 2.0
    seen = 0.15**2 / (resistance + 0.15 * r)
    alike = 0.5 * seen * r + np.sqrt((0.5 * seen * r) ** 2 + 0.1 * seen)
    found = ematwin.identify(record, actuator=guessed, exact=True)
    assert found.estimate["short_a"] == pytest.approx(alike, abs=0.005)
    found = ematwin.identify(record, actuator=guessed)
    low, high = found.intervals["short_a"]
    assert low <= 0.15 <= high
    assert low > 0.05
