"""A study from Python: one call, with an algorithm of one's own in the worker processes."""

import pytest

import ematwin
from ematwin.errors import InputError
from ematwin.optimizers.base import RandomSearch


@pytest.mark.usefixtures("registrations")
def test_a_study_of_an_own_algorithm_in_one_call(tmp_path):
    class Own(RandomSearch):
        """Not importable by the workers: it travels with them."""

    ematwin.register("own", Own)
    seen = []
    study = ematwin.compare(
        ["random", "own"], {"worn": {"friction": 2.0}}, runs=2, population=6, iterations=3,
        actuator="rm1605", workers=1, store=tmp_path / "study.db", progress=seen.append,
    )  # fmt: skip
    assert study.table.done.all()
    assert list(study.to_frame()["algorithm"]) == study.table.algorithms == ["random", "own"]
    assert len(study.to_frame("run")) == 4
    assert seen[-1].complete == 4
    figures = study.plot()
    assert {"Convergence", "Distribution of Err%"} <= set(figures)
    assert all(figure.data for figure in figures.values())
    assert repr(study) == "StudyAnalysis(4 runs of random, own on 1 cases)"
    assert "has the lowest mean Err% on 1 of 1 case" in study.lead
    assert str(study).splitlines() == [study.lead, *study.conclusions]
    html = study._repr_html_()
    assert html.index("lowest mean Err%") < html.index("<table")
    with pytest.raises(InputError, match="each must be cell or run"):
        study.to_frame("day")


def test_a_wrong_case_is_named():
    with pytest.raises(InputError, match="Case 'worn': Unknown fault 'fricton'"):
        ematwin.compare(["random"], {"worn": {"fricton": 2.0}}, actuator="rm1605")
    with pytest.raises(InputError, match="workers must be at least 1"):
        ematwin.compare(["random"], actuator="rm1605", workers=0)
    said = r"runs must be a whole number of at least 1, received 2\.5"
    with pytest.raises(InputError, match=said):
        ematwin.compare(["random"], actuator="rm1605", runs=2.5)
