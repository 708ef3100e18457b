"""``ematwin identifiability`` from the shell."""

import json
import re
from pathlib import Path

import pytest


def test_commands_are_ranked_and_shown(ematwin, tmp_path: Path) -> None:
    answer = ematwin("identifiability", "ramp", "default", "--exact", "--report", "page.html")
    assert answer.code == 0, answer.err
    assert answer.out.index("default, 0.5 s") < answer.out.index("ramp, 2 s")
    assert "Most telling first" in answer.out
    assert "correlation" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_programs_get_all_of_it(ematwin) -> None:
    answer = ematwin("identifiability", "--json", "--fault", "friction=0.3")
    told = json.loads(answer.out)["commands"][0]
    assert told["faults"]["friction"] == 0.3
    assert {"friction", "backlash", "gain"} <= {one["name"] for one in told["told"]}


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
    assert answer.code == 2
    assert re.fullmatch(r"Error: [^\n]*[.?]\n", answer.err), answer.err
    assert said in answer.err
