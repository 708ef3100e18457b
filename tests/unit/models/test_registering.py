"""A kind of actuator named in a process: the one that docs/your-own-model.md writes."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import ematwin
from ematwin.errors import InputError
from own_model import forgotten

NOTEBOOK = Path(__file__).parents[3] / "docs" / "your-own-model.md"
CELLS = r"^```\{code-cell\} ipython3\n%%writefile (voice_coil/\S+)\n(.*?)^```"


@pytest.fixture
def voice_coil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The model of the notebook, from the files that it writes."""
    (tmp_path / "voice_coil" / "scenarios").mkdir(parents=True)
    (tmp_path / "voice_coil" / "__init__.py").touch()
    for name, text in re.findall(CELLS, NOTEBOOK.read_text("utf-8"), re.DOTALL | re.MULTILINE):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    from voice_coil.model import MODEL

    with forgotten():
        yield MODEL
    for name in [name for name in sys.modules if name.startswith("voice_coil")]:
        del sys.modules[name]


def test_a_kind_is_known_once_it_is_registered_to_worker_processes_as_well(
    voice_coil: Any, tmp_path: Path
) -> None:
    with pytest.raises(ematwin.EmatwinError, match="There is no actuator 'vc25'"):
        ematwin.load_actuator("vc25")
    ematwin.register_model(voice_coil)
    study = ematwin.compare(
        ["random"], {"weak": {"magnet": 0.9}}, runs=1, population=4, iterations=2,
        actuator="vc25", workers=1, store=tmp_path / "study.db",
    )  # fmt: skip
    assert study.table.done.all()


def test_what_is_no_model_of_ones_own_is_refused(voice_coil: Any) -> None:
    with pytest.raises(InputError, match="takes an instance of a Model"):
        ematwin.register_model(type(voice_coil))

    class Brushless(type(voice_coil)):  # type: ignore[misc]
        kind = "bldc"

    with pytest.raises(InputError, match="'bldc' comes with ematwin"):
        ematwin.register_model(Brushless())


@pytest.mark.parametrize("by_file", [True, False], ids=["a module", "a notebook"])
def test_a_kind_may_stand_in_a_module_without_a_package(tmp_path: Path, by_file: bool) -> None:
    """Its files lie beside it, or in the folder of the notebook."""
    cells = re.findall(CELLS, NOTEBOOK.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    files = {name.removeprefix("voice_coil/"): text for name, text in cells}
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "pyproject.toml").write_text("[project]\n", encoding="utf-8")
    source = re.sub("from voice_coil.parameters import.*", "", files["parameters.py"])
    source += re.sub("from voice_coil.parameters import.*", "", files["model.py"])
    source += """
import ematwin
ematwin.register_model(MODEL)
assert list(VoiceCoil.shipped()) == ["vc25"]
record = ematwin.simulate(actuator="vc25", faults={"magnet": 0.9})
print(ematwin.identify(record, "vc25", exact=True).verdict.faults)
"""
    for name in ("vc25.toml", "scenarios/sweep.toml"):
        (tmp_path / name).write_text(files[name], encoding="utf-8")
    (tmp_path / "coil.py").write_text(source, encoding="utf-8")
    given = {"args": [sys.executable, "coil.py"]} if by_file else {
        "args": [sys.executable, "-"], "input": source
    }  # fmt: skip
    done = subprocess.run(
        cwd=tmp_path, text=True, capture_output=True, timeout=120, check=False, **given
    )
    assert done.stdout == "('magnet',)\n", done.stderr
