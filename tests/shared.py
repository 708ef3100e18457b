"""Results that the processes of pytest share: the first that needs one makes it."""

import fcntl
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A file of this name that ``make`` writes, unless another process has."""
    folder = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    path = folder / name
    with Path(f"{path}.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        if not path.exists():
            draft = factory.mktemp("draft") / name
            make(draft)
            draft.rename(path)
    return path


def computed_once(factory: pytest.TempPathFactory, name: str, compute: Callable[[], Any]) -> Any:
    """What ``compute`` gives here or gave in another process."""
    path = made_once(factory, name, lambda path: path.write_bytes(pickle.dumps(compute())))
    return pickle.loads(path.read_bytes())
