"""``ematwin bench``: which figures it gives, never how fast they are."""

import json


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
