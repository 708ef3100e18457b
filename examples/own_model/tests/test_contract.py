"""The model keeps the contract of ematwin: ``pytest`` in this folder, once it is installed."""

import pytest

from ematwin.testing.model_contract import ModelContract
from ematwin_dc_gearmotor.model import MODEL


class TestDcGearmotor(ModelContract):
    """All of it, as it stands."""

    step = "steps.twin"

    @pytest.fixture
    def model(self):
        """The model of this package."""
        return MODEL
