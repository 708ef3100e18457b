"""Import is quiet and quick, and the twin runs without the extras."""

import json
from pathlib import Path

import pytest

from commands import fresh

PROJECT = Path(__file__).parents[2]
HEAVY = {"numba", "numpy", "scipy", "plotly", "pandas", "pyarrow", "pydantic", "pint", "typer",
         "rich", "jinja2"}  # fmt: skip
EXTRAS = {"asammdf", "nptdms", "pymatreader", "h5py", "cma", "pymoo", "pygmo", "nevergrad",
          "pandas", "psutil", "sphinx", "hypothesis", "pytest", "anywidget"}  # fmt: skip


def python(code: str, *arguments: object) -> str:
    """What a fresh interpreter prints."""
    done = fresh(code, *arguments)
    assert (done.code, done.err) == (0, "")
    return done.out


def test_importing_opens_no_file_but_those_of_python_itself():
    opened = json.loads(
        python(
            """
import json, sys
opened = []
def watch(event, arguments):
    if event == "open" and isinstance(arguments[0], str):
        opened.append(arguments[0])
    if event.startswith(("socket.", "subprocess.", "os.mkdir", "os.remove", "_thread.")):
        opened.append(event)
sys.addaudithook(watch)
import ematwin
print(json.dumps(opened))
"""
        )
    )
    assert opened
    assert [name for name in opened if not name.endswith((".py", ".pyc", ".so"))] == []


def test_importing_loads_none_of_the_heavy_libraries_and_none_of_our_own_modules():
    loaded = set(json.loads(python("import ematwin, json, sys; print(json.dumps([*sys.modules]))")))
    assert {name.partition(".")[0] for name in loaded} & HEAVY == set()
    assert {name for name in loaded if name.startswith("ematwin.")} == set()


def test_importing_prints_nothing_and_changes_no_logging_or_warnings():
    code = """
import logging, signal, warnings
before = (list(warnings.filters), list(logging.root.handlers), signal.getsignal(signal.SIGINT))
import ematwin
ematwin.simulate, ematwin.read, ematwin.Faults  # what is loaded on use is as quiet
after = (list(warnings.filters), list(logging.root.handlers), signal.getsignal(signal.SIGINT))
assert before[1:] == after[1:], (before, after)
"""
    assert python(code) == ""


def test_every_public_name_can_be_had_and_is_listed():
    import ematwin

    for name in ematwin.__all__:
        member = getattr(ematwin, name)
        assert member.__name__ == name
        assert member.__doc__, name
    assert ematwin.Faults.__module__ == "ematwin.models.bldc.faults"  # of version 0.2
    assert set(ematwin.__all__) <= set(dir(ematwin))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = ematwin.simulat


def test_it_simulates_writes_and_reads_without_any_extra(tmp_path):
    code = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
EXTRAS = set(sys.argv[2].split(","))
import ematwin
record = ematwin.simulate("reference", "step", {"friction": 0.25}, noise=ematwin.Noise(white=0.1))
for name in ("a.parquet", "a.csv"):
    ematwin.write(record, f"{sys.argv[1]}/{name}")
    assert len(ematwin.read(f"{sys.argv[1]}/{name}")) == len(record)
print(ematwin.Faults(friction=0.25))
from ematwin.cli.app import run
sys.argv = ["ematwin", "simulate", "--model", "monitor", "--plot", f"{sys.argv[1]}/a.html"]
sys.exit(run())
"""
    assert "friction" in python(code, str(tmp_path), ",".join(EXTRAS))
    assert (tmp_path / "a.html").stat().st_size > 1000


def test_the_numbers_of_the_package_and_its_metadata_agree():
    import tomllib

    import ematwin

    table = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    assert table["project"]["version"] == ematwin.__version__
    citation = (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {ematwin.__version__}\n" in citation
