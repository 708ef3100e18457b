"""Which process holds a claim, and whether it still lives."""

import os
import socket
import uuid


def owner_name() -> str:
    """A name for this process that no other has: where it runs, its number, and chance."""
    return f"{_place()} {os.getpid()} {uuid.uuid4().hex[:12]}"


def is_dead(owner: str) -> bool:
    """Whether the process is known to have ended; False where it cannot be seen from here."""
    parts = owner.rsplit(" ", 2)
    if len(parts) != 3 or parts[0] != _place() or os.name != "posix" or not parts[1].isdigit():
        return False
    try:
        os.kill(int(parts[1]), 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


def _place() -> str:
    """The machine and, where there are such, the space in which its process numbers count."""
    try:
        space = os.readlink("/proc/self/ns/pid")
    except OSError:
        space = ""
    return f"{socket.gethostname()} {space}".strip()
