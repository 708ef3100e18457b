"""The picture of the imports is that of the code, and nothing imports upwards."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

PROJECT = Path(__file__).parents[2]
PACKAGE = PROJECT / "src" / "ematwin"


def import_matrix() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "import_matrix", PROJECT / "docs" / "import_matrix.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_matrix_in_the_documentation_is_that_of_the_code() -> None:
    page = (PROJECT / "docs" / "architecture.md").read_text(encoding="utf-8")
    shown = re.search(r"<!-- matrix -->\n```text\n(.*?)\n```\n<!-- end", page, re.DOTALL)
    assert shown is not None
    assert shown[1] == import_matrix().matrix(PACKAGE), "run python docs/import_matrix.py"


def test_nothing_above_the_models_imports_a_kind_of_actuator() -> None:
    tool = import_matrix()
    found = tool.parts_of(PACKAGE, tool.ORDER)
    for part in ("estimation", "monitoring", "report"):
        for kind in ("models.bldc", "models.ball_screw", "models.pmsm"):
            assert found[part][kind] == set(), part
    for kind in ("models.bldc", "models.ball_screw", "models.pmsm", "models", "recordings"):
        for part in ("estimation", "monitoring", "optimizers", "benchmarking", "report", "cli"):
            assert found[kind][part] == set(), kind


def test_the_kinds_do_not_know_each_other() -> None:
    tool = import_matrix()
    found = tool.parts_of(PACKAGE, tool.ORDER)
    assert found["models.bldc"]["models.ball_screw"] == set()
    assert found["models.ball_screw"]["models.bldc"] == set()
    for other in ("models.bldc", "models.ball_screw"):
        assert found["models.pmsm"][other] == set()
        assert found[other]["models.pmsm"] == set()


def test_every_part_has_a_row() -> None:
    parts = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    parts |= {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    assert parts <= set(import_matrix().ORDER)
