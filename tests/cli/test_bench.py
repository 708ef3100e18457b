"""``ematwin bench``: which figures it gives, never how fast they are."""

import json

from ematwin import bench


def test_the_figures_come_as_json(ematwin):
    answer = ematwin("bench", "--repeats", "1", "--json")
    assert (answer.code, answer.err) == (0, "")
    told = json.loads(answer.out)
    assert told["machine"].keys() >= {"processor", "cores", "python", "numba", "numpy"}
    names = [figure["name"] for figure in told["figures"]]
    assert names == [
        "10,000 scorings of the default scenario",
        "peak resident memory of 10,000 scorings",
        "reference model: simulated over real time",
    ]
    for figure in told["figures"]:
        assert 0.0 < figure["low"] <= figure["value"] <= figure["high"], figure
        bound, aim = figure["aim"].rsplit(" ", 1)
        assert bound in ("at least", "at most")
        reached = figure["value"] >= float(aim)
        assert figure["holds"] == (reached if bound == "at least" else not reached)
        assert figure["unit"] in ("times", "s", "MB")
        assert figure["detail"]


def test_a_figure_holds_when_its_median_reaches_the_aim():
    fast = bench.Figure.of("f", [3.0, 1.0, 2.0], "s", most=2.0, detail="d")
    assert (fast.value, fast.low, fast.high, fast.aim, fast.holds) == (
        2.0,
        1.0,
        3.0,
        "at most 2",
        True,
    )
    slow = bench.Figure.of("f", [3.0, 1.0, 2.0], "times", least=2.5, detail="d")
    assert (slow.aim, slow.holds) == ("at least 2.5", False)
