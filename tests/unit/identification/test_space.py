import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ematwin.errors import InputError
from ematwin.faults import FAULTS, Faults, error_percent_wrapped
from ematwin.identification.space import FaultSpace

vectors = arrays(float, (3, 8), elements=st.floats(0.0, 1.0))


@given(vectors)
def test_coordinates_of_a_fault_vector_lead_back_to_it(k: np.ndarray) -> None:
    space = FaultSpace()
    back = space.to_faults(space.from_faults(k))
    assert np.allclose(error_percent_wrapped(back, k), 0.0, atol=1e-6)


@given(arrays(float, (4, 8), elements=st.floats(-3.0, 3.0)))
def test_projected_points_are_fault_vectors(z: np.ndarray) -> None:
    space = FaultSpace()
    inside = space.project(z)
    assert (inside >= space.lower).all()
    assert (inside <= space.upper).all()
    k = space.to_faults(inside)
    assert (k >= 0.0).all()
    assert (k <= 1.0).all()
    assert np.allclose(space.project(inside), inside)


def test_held_faults_stay_at_their_values() -> None:
    space = FaultSpace(["backlash", "friction"], Faults(gain=0.7))
    assert space.names == ("friction", "backlash")
    k = space.to_faults(np.array([[0.1, 0.2]]))[0]
    assert k.tolist() == [0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.5, 0.7]


def test_direction_alone_is_searched_as_an_angle() -> None:
    space = FaultSpace(["eccentricity_phase"], Faults(eccentricity=0.4))
    assert not space.has_direction
    assert space.to_faults(np.array([[0.9]]))[0, FAULTS.index("eccentricity_phase")] == 0.9


def test_opposite_ends_of_the_phase_are_one_point() -> None:
    space = FaultSpace()
    k = np.tile(Faults(eccentricity=0.5).vector, (2, 1))
    k[:, 6] = [0.0, 1.0]
    z = space.from_faults(k)
    assert np.allclose(z[0], z[1])


@pytest.mark.parametrize(
    ("only", "said"), [(["fricton"], "Did you mean friction"), ([], "at least one")]
)
def test_impossible_choices_are_refused(only: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        FaultSpace(only)
