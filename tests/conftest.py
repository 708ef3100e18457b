"""What several tests share: the command line, one profile of hypothesis."""

import gc
import io
import logging
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings

from ematwin.cli import main

# The units of a developer's own settings do not reach the tests.
os.environ["XDG_CONFIG_HOME"] = str(Path(tempfile.gettempdir(), "ematwin-tests-settings"))
# The same examples in each run, on machines of any speed.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("repeatable")


@dataclass(frozen=True)
class Answer:
    """What the command line answered."""

    code: int
    out: str
    err: str


@pytest.fixture
def ematwin(tmp_path: Path) -> Callable[..., Answer]:
    """Run ``ematwin`` with some arguments in ``tmp_path``, as a process would, but within this one.

    Starting a process takes longer than most of what the tests ask for.
    """

    def run(*arguments: object, **environment: str) -> Answer:
        assert "PYTHONPATH" not in environment, "read at the start of a process: ematwin_process"
        out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
        with pytest.MonkeyPatch.context() as here, warnings.catch_warnings():
            here.chdir(tmp_path)
            here.setattr(gc, "set_threshold", lambda most: None)  # this process goes on
            here.setattr(sys, "argv", ["ematwin", *map(str, arguments)])
            for name, value in environment.items():
                here.setenv(name, value)
            for name, stream in (("stdin", io.StringIO()), ("stdout", out), ("stderr", err)):
                here.setattr(sys, name, stream)
            # warnings and logs go to standard error, as where pytest does not catch them
            here.setattr(logging.getLogger(), "handlers", [])
            here.setattr(warnings, "showwarning", lambda *w: err.write(warnings.formatwarning(*w)))
            warnings.resetwarnings()
            for category in (DeprecationWarning, PendingDeprecationWarning, ResourceWarning):
                warnings.simplefilter("ignore", category)  # as Python does
            with pytest.raises(SystemExit) as ended:
                main()
        for stream in (out, err):
            stream.flush()
        code = ended.value.code
        assert isinstance(code, int)
        return Answer(code, *(x.buffer.getvalue().decode() for x in (out, err)))

    return run


@pytest.fixture
def ematwin_process(tmp_path: Path) -> Callable[..., Answer]:
    """Run ``python -m ematwin`` with some arguments, as a process of its own in ``tmp_path``."""

    def run(*arguments: object, **environment: str) -> Answer:
        done = subprocess.run(
            [sys.executable, "-m", "ematwin", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        return Answer(done.returncode, done.stdout, done.stderr)

    return run
