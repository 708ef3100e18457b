"""What several tests share: the command line, a PostgreSQL, one profile of hypothesis."""

import os
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# As ``ematwin`` does, before numpy is loaded: threads of several workers wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from commands import Answer, inside, python
from ematwin.cli import main
from own_model import forgotten

# The units of a developer's own settings do not reach the tests.
os.environ["XDG_CONFIG_HOME"] = str(Path(tempfile.gettempdir(), "ematwin-tests-settings"))
# The same examples in each run, on machines of any speed.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("repeatable")


@pytest.fixture
def ematwin(tmp_path: Path) -> Callable[..., Answer]:
    """Run ``ematwin`` with some arguments in ``tmp_path``, within this process."""

    def run(*arguments: object, **environment: str) -> Answer:
        return inside(main, "ematwin", *arguments, folder=tmp_path, **environment)

    return run


@pytest.fixture
def done(ematwin: Callable[..., Answer]) -> Callable[..., Answer]:
    """`ematwin`, which has to succeed."""

    def run(*arguments: object) -> Answer:
        answer = ematwin(*arguments)
        assert answer.code == 0, answer.err
        return answer

    return run


@pytest.fixture
def registrations() -> Iterator[None]:
    """What a test registers is forgotten after it."""
    with forgotten():
        yield


@pytest.fixture
def ematwin_process(tmp_path: Path) -> Callable[..., Answer]:
    """Run ``python -m ematwin`` with some arguments, as a process of its own in ``tmp_path``."""
    return partial(python, "-m", "ematwin", folder=tmp_path)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Any]:
    """A real server for the whole session, in a folder of its own."""
    from servers import Postgres  # here: it takes a second to import

    with tempfile.TemporaryDirectory(prefix="ematwin-postgres-") as folder:
        server = Postgres(Path(folder))
        server.start()
        yield server
        server.stop()
