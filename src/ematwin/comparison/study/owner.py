"""Which process holds a claim, and whether it still lives."""

import os
import socket
import uuid
from functools import cache


def owner_name() -> str:
    """A name for this process that no other has: where it runs, its number, and chance."""
    return f"{_place()} {os.getpid()} {uuid.uuid4().hex[:12]}"


def is_dead(owner: str) -> bool:
    """Whether the process is known to have ended; False where it cannot be seen from here."""
    if not isinstance(owner, str):  # of a damaged row
        return True
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


@cache
def _place() -> str:
    """The machine and, where there are such, the space in which its process numbers count.

    Machines may share a host name, so the number of this boot stands beside it: the process table
    of another machine says nothing of our owners.
    """
    try:
        space = os.readlink("/proc/self/ns/pid")
    except OSError:
        space = ""
    return " ".join(part for part in (socket.gethostname(), _boot(), space) if part)


def _boot() -> str:
    """The number of this boot of this machine; that of its network card where there is none."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="ascii") as file:
            return file.read().strip()
    except OSError:
        return f"{uuid.getnode():012x}"
