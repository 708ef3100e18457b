"""One process compiles a loop; others that need it at the same time wait for what it keeps.

Workers of a study, or tests, start together on an empty cache and would all compile the same, each
for ten seconds or more. The lock is the system's, so that a process that dies gives it up; where
there are no such locks (other systems than POSIX, some network drives), each compiles for itself.
"""

import os
import time
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

_LONGEST = 120.0  # s, after which it is compiled all the same
_PAUSE = 0.05  # s between two trials


class Claim:
    """A right to compile what will be kept in a file.

    Parameters
    ----------
    path : Path, of that file; the lock lies beside it while it is held
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(f"{path.name}.lock")
        self._handle: int | None = None

    def take(self, longest: float = _LONGEST) -> bool:
        """Wait until no other process has it, at most ``longest`` s; whether there was a wait.

        Raises
        ------
        OSError
            If the folder takes no file.
        """
        if fcntl is None:
            return False
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        self._handle = os.open(self._path, flags, 0o600)
        waited = False
        end = time.monotonic() + longest
        while True:
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return waited
            except BlockingIOError:
                if time.monotonic() > end:  # it stays the other's
                    self._close()
                    return True
                waited = True
                time.sleep(_PAUSE)
            except OSError:
                self.release()
                raise

    def release(self) -> None:
        """Let others have it; nothing happens if it was not taken."""
        if self._handle is None:
            return
        with suppress(OSError):
            self._path.unlink()
        self._close()

    def _close(self) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
