"""Real servers for studies: a PostgreSQL in a folder of its own, a Dask scheduler with workers."""

import contextlib
import os
import pwd
import shutil
import subprocess
import sys
from pathlib import Path

import psutil
from distributed import Client
from processes import free_port


class Postgres:
    """A private PostgreSQL server in a folder of its own."""

    def __init__(self, folder):
        self._bin = _binaries()
        self._data = folder / "data"
        self._log = folder / "log"
        self.port = free_port()
        self._user = "postgres" if os.geteuid() == 0 else None  # it refuses to run as root
        if self._user:
            shutil.chown(folder, self._user)
        self._as_user(
            "initdb", "-D", self._data, "-U", "ematwin", "--auth=trust", "--no-sync", "-E", "UTF8"
        )

    def _as_user(self, program, *arguments):
        account = None if self._user is None else pwd.getpwnam(self._user)
        identity = {} if account is None else {"user": account.pw_uid, "group": account.pw_gid}
        subprocess.run(
            [str(self._bin / program), *map(str, arguments)],
            check=True, stdout=subprocess.DEVNULL, cwd="/", **identity,
        )  # fmt: skip

    def start(self):
        """Start, and wait until it answers."""
        options = f"-p {self.port} -h 127.0.0.1 -c fsync=off -k ''"
        self._as_user("pg_ctl", "-D", self._data, "-l", self._log, "-o", options, "-w", "start")

    def stop(self):
        """Stop at once; connections break."""
        self._as_user("pg_ctl", "-D", self._data, "-m", "immediate", "-w", "stop")

    def database(self, name):
        """URL of a new, empty database."""
        arguments = ("-h", "127.0.0.1", "-p", self.port, "-U", "ematwin", name)
        self._as_user("createdb", *arguments)
        return f"postgresql://ematwin@127.0.0.1:{self.port}/{name}"


def _binaries():
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    path = str(found[-1]) if found else shutil.which("initdb")
    if path is None:
        raise RuntimeError("This needs a real PostgreSQL: apt-get install postgresql")
    return Path(path).parent


class Cluster:
    """A scheduler and two workers, started with the commands of docs/cluster.md."""

    def __init__(self, folder):
        self._folder = folder
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = self._scheduler()
        self.workers = [self.worker() for _ in range(2)]

    def _dask(self, *arguments):
        return psutil.Popen(
            [sys.executable, "-m", "dask", *map(str, arguments)],
            cwd=self._folder,
            env={**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "60s"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def _scheduler(self):
        return self._dask("scheduler", "--host", "127.0.0.1", "--port", self.port, "--no-dashboard")

    def worker(self):
        """Start a worker."""
        return self._dask("worker", self.address, "--nthreads", 1, "--no-dashboard")

    def wait(self):
        """Wait until all have found each other."""
        with Client(self.address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)

    def restart(self):
        """Start all anew, at the same address."""
        self.stop()
        self.scheduler = self._scheduler()
        self.workers = [self.worker() for _ in range(2)]
        self.wait()

    def stop(self):
        """End all processes."""
        for one in (*self.workers, self.scheduler):
            self.end(one)

    def end(self, one):
        """End a process and those that it started."""
        with contextlib.suppress(psutil.NoSuchProcess):
            for member in [*one.children(recursive=True), one]:
                with contextlib.suppress(psutil.NoSuchProcess):
                    member.kill()
        one.wait()
