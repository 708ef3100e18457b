"""The benchmark of intervals and probabilities counts what it says it counts."""

import numpy as np
import pytest
from benchmarks import certainty

# the scripts import one another by the folder that they lie in
import certainty_answers as answers  # isort: skip
import certainty_tables as tables  # isort: skip
import populations  # isort: skip

TASK = certainty.Task("healthy", "exact", "monitor", 1, "laplace")


def row(**changed):
    """A recording with a friction of 0.1, found right and named."""
    names = populations.FAULTS
    truth = populations.healthy(np.random.default_rng(0)) | {"friction": 0.1}
    made = {
        **TASK._asdict(),
        "population": "slight",
        "truth": truth,
        "values": dict(truth),
        "intervals": {name: [truth[name] - 0.01, truth[name] + 0.01] for name in names},
        "present": {name: float(name == "friction") for name in tables.MAGNITUDES},
        "ranks": dict.fromkeys(names, 0.5),
        "grade": "fault",
        "named": ["friction"],
        "seconds": 1.0,
    }
    return made | changed


def test_an_interval_holds_a_direction_a_turn_further():
    turned = row()
    turned["intervals"]["eccentricity_phase"] = [0.9, 1.1]
    turned["truth"]["eccentricity_phase"] = 0.05
    assert tables.holds(turned, "eccentricity_phase")
    turned["truth"]["eccentricity_phase"] = 0.2
    assert not tables.holds(turned, "eccentricity_phase")


def test_wrong_is_silent_only_with_a_verdict():
    wrong = row()
    wrong["truth"]["gain"] = 0.6
    assert tables.is_silently_wrong(wrong)
    assert not tables.is_silently_wrong(wrong | {"grade": "none"})
    assert not tables.is_silently_wrong(row())


def test_probabilities_are_counted_by_what_came_true():
    missed = row()
    missed["present"] = missed["present"] | {"gain": 0.6}  # and the gain was healthy
    bins = {(one.low, one.high): one for one in tables.reliability([row(), missed])}
    assert bins[(0.99, 1.0)].came == bins[(0.99, 1.0)].count == 2
    assert bins[(0.5, 0.7)].came == 0
    assert bins[(0.5, 0.7)].said == pytest.approx(0.6)


def test_a_false_alarm_is_counted():
    alarm = row(population="healthy", truth=populations.healthy(np.random.default_rng(0)))
    text = tables.verdicts([alarm, row()])
    assert "| 1, 95 %: 20.7 to 100.0 % |" in text


def test_ranks_of_draws_around_the_truth_are_uniform_and_of_narrow_ones_not():
    rng = np.random.default_rng(3)
    right, narrow = [], []
    for _ in range(200):
        truth = {"friction": rng.standard_normal()}
        seen = truth["friction"] + rng.standard_normal()
        draws = 0.5 * seen + np.sqrt(0.5) * rng.standard_normal((500, 1))
        for found, scale in ((right, 1.0), (narrow, 0.4)):
            spread = 0.5 * seen + scale * (draws - 0.5 * seen)
            found.append(answers.ranks(answers.Draws(("friction",), spread, {}), truth)["friction"])
    assert tables.uniformity(right).p > 0.01
    assert tables.uniformity(narrow).p < 1e-6


def test_draws_at_the_bound_of_a_healthy_fault_count_by_half():
    drawn = answers.Draws(("friction",), np.array([[0.0], [0.0], [0.1], [0.2]]), {})
    assert answers.ranks(drawn, {"friction": 0.0}) == {"friction": 0.25}


def test_verdicts_on_recordings_of_the_reference_model(tmp_path, capsys):
    text = certainty.main(
        ["verdicts", "--quick", "--knowledge", "exact", "--store", str(tmp_path),
         "--figure", str(tmp_path / "reliability.svg")]
    )  # fmt: skip
    assert text in capsys.readouterr().out
    rows = certainty.Store(tmp_path).rows()
    assert len(rows) == 2 * certainty.QUICK
    assert not any(one["grade"] == "fault" for one in rows if one["population"] == "healthy")
    assert not any(tables.is_silently_wrong(one) for one in rows)
    assert "<svg" in (tmp_path / "reliability.svg").read_text()
    again = certainty.main(["verdicts", "--stored", "--store", str(tmp_path)])
    assert again == text


def test_coverage_and_ranks_on_recordings_of_the_twin(tmp_path):
    common = ["--quick", "--knowledge", "exact", "--store", str(tmp_path)]
    text = certainty.main(["coverage", *common, "--fidelity", "monitor", "--methods", "laplace"])
    assert text.count("mixture, exact, monitor") == 1
    figure = tmp_path / "ranks.svg"
    text = certainty.main(
        ["calibration", *common, "--methods", "laplace own", "--figure", str(figure)]
    )
    assert "laplace own" in text
    ranks = [one["ranks"] for one in certainty.Store(tmp_path).rows() if one["ranks"]]
    assert all(0.0 <= share <= 1.0 for one in ranks for share in one.values())
    assert "<svg" in figure.read_text()
