"""Kinds and methods of others: the package ``examples/own_model``, and what is registered.

Wheels need a build backend, and that a network. What an installer leaves behind is little: the
package, and the entry points of its ``pyproject.toml`` beside it. `.ci/run` installs it with pip.
"""

import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ematwin.models import registry
from ematwin.optimizers import registry as methods

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_model"


def installed(folder: Path, name: str, **points: str) -> None:
    """Put into a folder what an installer leaves of a package's entry points, by their group."""
    info = folder / f"{name}-1.dist-info"
    info.mkdir(parents=True)
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n"
    (info / "METADATA").write_text(metadata, encoding="utf-8")
    text = "".join(f"[ematwin.{group}]\n{lines}\n" for group, lines in points.items())
    (info / "entry_points.txt").write_text(text, encoding="utf-8")


def laid_out(folder: Path) -> Path:
    """Put the package into a folder, as an installer would; gives the folder."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    shutil.copytree(
        EXAMPLE / "src", folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__")
    )
    groups = {
        group.removeprefix("ematwin."): "\n".join(f"{name} = {at}" for name, at in points.items())
        for group, points in project["entry-points"].items()
    }
    installed(folder, project["name"], **groups)
    return folder


@contextmanager
def on_path(folder: Path) -> Iterator[None]:
    """Packages are found in a folder for a while."""
    with pytest.MonkeyPatch.context() as here:
        here.syspath_prepend(folder)
        registry.models.cache_clear()
        yield
    registry.models.cache_clear()


@contextmanager
def forgotten() -> Iterator[None]:
    """What is registered meanwhile is forgotten in the end."""
    yield
    methods._REGISTERED.clear()
    registry._REGISTERED.clear()
    registry.models.cache_clear()
