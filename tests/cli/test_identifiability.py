"""``ematwin identifiability`` from the shell."""

from pathlib import Path

import pytest

from refusals import refused


def test_commands_are_ranked_and_shown(done, tmp_path: Path) -> None:
    answer = done("identifiability", "ramp", "default", "--exact", "--report", "page.html")
    assert answer.out.index("default, 0.5 s") < answer.out.index("ramp, 2 s")
    assert "Best command first" in answer.out
    assert "correlation" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_programs_get_all_of_it(ematwin) -> None:
    answer = ematwin("identifiability", "--actuator", "rm1605", "--json", "--fault", "friction=1.3")
    told = answer.told["commands"][0]
    assert told["faults"]["friction"] == 1.3
    assert {"friction", "backlash", "gain"} <= {one["name"] for one in told["told"]}


def test_indices_of_sobol_are_shown_on_request(done, tmp_path: Path) -> None:
    options = ("--actuator", "rm1605", "--exact", "--sobol", "--report", "page.html")
    answer = done("identifiability", *options)
    assert "Sobol indices" in answer.out
    assert "by itself" in (tmp_path / "page.html").read_text(encoding="utf-8")
    told = done("identifiability", *options[:4], "--json").told["commands"][0]
    assert set(told["sobol"]["total"]) == {"position_error", "current"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["nonsense"], "There is no scenario 'nonsense'"),
        (["--miss", "0.7"], "--miss must lie between 0 and 0.5, received 0.7"),
        (["--fault", "wear=1"], "wear"),
        (["--report", "page.pdf"], "html"),
    ],
)
def test_wrong_input_gets_one_sentence(ematwin, options: list[str], said: str) -> None:
    answer = ematwin("identifiability", *options)
    refused(answer, said)
