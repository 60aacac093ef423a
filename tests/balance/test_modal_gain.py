"""INCA's criteria by hand."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import RANKINGS, Gregory, ModalGain
from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.model import ModalChannels
from tests.lyapunov import mixed, response

TWO = ModalChannels(
    "two",
    np.array([2.0, 10.0]),
    np.array([0.01, 0.02]),
    np.array([[3.0, 4.0], [0.0, 1.0]]),
    np.array([[1.0, 0.0], [2.0, 6.0]]),
    np.array([[0.5, 0.8]]),
)


def test_two_modes_by_hand():
    """|b| = 5 and 1; |c|^2 = 1 + 4 + 4 * 0.25 and 36 + 100 * 0.64."""
    gain = [5 * np.sqrt(6.0), 10.0]
    np.testing.assert_allclose(ModalGain().coefficients(TWO), gain, rtol=1e-14)
    np.testing.assert_allclose(2 * Gregory().coefficients(TWO), [gain[0] / 0.08, gain[1] / 4], rtol=1e-14)


def test_the_response_at_resonance_is_twice_gregorys_coefficient():
    one = replace(TWO.only([1]), C2=np.zeros((1, 1)))
    at_resonance = np.linalg.norm(response(one, one.omega))
    assert 2 * Gregory().coefficients(one)[0] == pytest.approx(at_resonance, rel=1e-12)


def test_modal_gain_needs_no_damping_and_the_others_say_so():
    undamped = replace(TWO, zeta=np.zeros(2))
    np.testing.assert_array_equal(ModalGain().coefficients(undamped), ModalGain().coefficients(TWO))
    for name in ("gregory", "hankel", "component-cost"):
        with pytest.raises(DampingError, match=r"'two': .*rank by modal-gain or frequency"):
            RANKINGS[name].coefficients(undamped)


@pytest.mark.parametrize("name", RANKINGS)
@pytest.mark.parametrize(("modes", "inputs", "outputs"), [(3, 2, 0), (3, 0, 2), (0, 2, 2), (0, 0, 0)])
def test_without_inputs_outputs_or_modes_there_is_nothing_and_no_nan(name, modes, inputs, outputs):
    omega = np.array([1.0, 1.0, 2.0])[:modes]
    B, C = np.ones((modes, inputs)), np.ones((outputs, modes))
    none = ModalChannels("edge", omega, np.full(modes, 0.01), B, C, C)
    found = RANKINGS[name].coefficients(none)
    np.testing.assert_array_equal(found, 2 * np.pi / omega if name == "frequency" else np.zeros(modes))


@pytest.mark.parametrize("name", sorted(set(RANKINGS) - {"frequency"}))
def test_a_mode_with_no_part_in_it_is_last(name):
    ch = replace(mixed(0), C1=mixed(0).C1 * [1, 1, 1, 1, 0, 1], C2=mixed(0).C2 * [1, 1, 1, 1, 0, 1])
    found = RANKINGS[name].coefficients(ch)
    assert found[4] == 0 and (np.delete(found, 4) > 0).all()


@pytest.mark.parametrize("omega", [0.0, np.inf, -1.0, np.nan])
def test_a_rigid_or_static_mode_cannot_get_in(omega):
    with pytest.raises(MatrixError, match=r"'two': a rigid or static mode.* cannot be ranked"):
        replace(TWO, omega=np.array([omega, 10.0]))
