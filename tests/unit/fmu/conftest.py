"""Archives of shipped actuators, each exported once."""

from functools import cache

import pytest

import ematwin


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
    """Path of an archive, made once for each kind and fidelity."""
    folder = tmp_path_factory.mktemp("fmus")

    @cache
    def made(name, fidelity, fmi=3):
        return ematwin.export_fmu(
            name, folder / f"{name}-{fidelity}-{fmi}.fmu", fidelity=fidelity, fmi=fmi
        )

    return made
