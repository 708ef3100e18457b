"""Look through a store and, if it is damaged, carry what is whole to a new one."""

from pathlib import Path

from ematwin.comparison.study.database import Database
from ematwin.comparison.study.store import Store, open_store
from ematwin.comparison.study.survey import Survey, survey, survey_file
from ematwin.errors import FileError

_TOGETHER = 500  # runs saved at a time


def check(where: str | Path) -> Survey:
    """Verify every run of a store.

    Parameters
    ----------
    where : path of a SQLite file, or a URL such as postgresql://user@host/name

    Raises
    ------
    FileError
        If there is no study, or the structure of the file is damaged.
    """
    found = _looked(where)
    if not found.damaged:
        with open_store(where) as store:  # SQLite's own check: its indexes, its free pages
            for _ in store.runs():
                pass
    return found


def rescue(where: str | Path, out: str | Path) -> Survey:
    """Carry the whole runs of a store, damaged or not, to a new one; the old one is not touched.

    Returns
    -------
    Survey, what was carried and what was not

    Raises
    ------
    FileError
        If nothing can be rescued, or ``out`` holds a study.
    """
    found = _looked(where)
    if found.settings is None:
        raise FileError(
            f"Nothing can be rescued from {where}: no copy of its study's settings is whole. "
            "Put a copy of the store in its place."
        )
    with Store(out) as new:
        if new.begun:
            raise FileError(f"{new.name} holds a study already; give another --out.")
        new.begin(found.settings)
        runs = [found.runs[id] for id in sorted(found.runs)]
        for n in range(0, len(runs), _TOGETHER):
            new.save(runs[n : n + _TOGETHER])
    return found


def _looked(where: str | Path) -> Survey:
    if "://" not in str(where):
        path = Path(where)
        if not path.is_file():
            raise FileError(f"There is no store {path}.")
        return survey_file(path)
    database = Database(where)
    try:
        return survey(database)
    finally:
        database.close()
