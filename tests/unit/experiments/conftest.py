"""Kinds of one's own, registered for a while."""

from contextlib import contextmanager

import pytest

import ematwin
from ematwin.models import registry


@pytest.fixture(scope="session")
def registered():
    """Gives a context in which a model is known."""

    @contextmanager
    def known(model):
        with pytest.MonkeyPatch.context() as here:
            here.setattr(registry, "_REGISTERED", dict(registry._REGISTERED))
            ematwin.register_model(model)
            yield
        registry.models.cache_clear()

    return known
