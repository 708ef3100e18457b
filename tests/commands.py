"""Commands and scripts, run within the process of the tests: its start takes longer than most."""

import gc
import io
import json
import logging
import os
import runpy
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest


@dataclass(frozen=True)
class Answer:
    """What a process answers."""

    code: int
    out: str
    err: str

    @property
    def told(self) -> Any:
        """The answer of ``--json``."""
        return json.loads(self.out)


def inside(
    call: Callable[[], object], *words: object, folder: Path | None = None, **environment: str
) -> Answer:
    """Call a program as its own process would be, in ``folder``, with ``words`` as its command."""
    assert "PYTHONPATH" not in environment, "read at the start of a process: ematwin_process"
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    code: object = None
    with pytest.MonkeyPatch.context() as here, warnings.catch_warnings():
        if folder is not None:
            here.chdir(folder)
        here.setattr(gc, "set_threshold", lambda most: None)  # this process goes on
        here.setattr(sys, "argv", [*map(str, words)])
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
        try:
            call()
        except SystemExit as leaving:
            code = leaving.code
        if isinstance(code, str):
            print(code, file=err)  # as Python does
            code = 1
    for stream in (out, err):
        stream.flush()
    assert code is None or isinstance(code, int)
    return Answer(code or 0, *(x.buffer.getvalue().decode() for x in (out, err)))


def python(*words: object, folder: Path | None = None, **environment: str) -> Answer:
    """Run a Python of its own."""
    done = subprocess.run(
        [sys.executable, *map(str, words)], cwd=folder, env={**os.environ, **environment},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    return Answer(done.returncode, done.stdout, done.stderr)


def fresh(code: str, *arguments: object, **more: Any) -> Answer:
    """Run code in an interpreter of its own."""
    return python("-B", "-c", code, *arguments, **more)


def loaded(names: set[str], *words: object, **more: Any) -> Answer:
    """`fresh`, for a command in words; standard error says which of some modules it loads."""
    code = f"""
import sys
from ematwin.cli import main
sys.argv = {["ematwin", *map(str, words)]!r}
try:
    main()
finally:
    print(*sorted({names!r} & set(sys.modules)), file=sys.stderr)
"""
    return fresh(code, **more)


def script(path: Path, *arguments: object) -> Answer:
    """Run a script with some arguments."""
    return inside(lambda: runpy.run_path(str(path), run_name="__main__"), path, *arguments)
