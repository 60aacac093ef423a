"""What the scene asks of a body: its i-set, its loads, and residuals for what is no interface."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.assemble import body_ports
from cmsreduce.errors import SceneError
from cmsreduce.model import Damping, DofTable, FEModel, ParameterTerm, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import METHODS, SceneKrylov, reduction
from tests.assemble.rigs import at, strut
from tests.frames import line, rotation

TURN = rotation([0.3, -0.5, 0.8], 0.9)


def bar(**options) -> FEModel:
    return line("bar", [0, 0, 0], [1.5, 0, 0], 6, interfaces={"root": 1}, **options)


def scene(actuators=(), sensors=()) -> Scene:
    return Scene(("bar",), (0.0, 100.0), (), actuators=tuple(actuators), sensors=tuple(sensors))


def row(body: FEModel, node: int, component: int) -> int:
    return int(body.dofs.rows(node, np.array([component]))[0])


THRUST = at("bar.4", [0, 1.0, 2.0, 0, 0, 0], "thruster")
PROBE = at("bar.6", "z", "probe")
RATE = at("bar.3", "ry", "rate", rate=True)


def test_actuators_are_in_the_interface_unless_they_are_residuals():
    body = bar()
    ports = body_ports(body, scene([THRUST], [PROBE]))
    y, z = row(body, 4, 2), row(body, 4, 3)
    assert ports.interface.tolist() == [*range(6), y, z]
    assert ports.loads.shape[1] == ports.residuals.shape[1] == 0
    ports = body_ports(body, scene([THRUST], [PROBE]), ["actuators"])
    assert ports.interface.tolist() == [*range(6)]
    assert ports.loads.shape == (body.n, 1) and ports.residuals.shape[1] == 0
    assert ports.loads[[y, z], 0].tolist() == [1.0, 2.0] and np.count_nonzero(ports.loads) == 2


def test_sensors_as_residuals_are_loads_along_what_they_measure():
    body = bar()
    ports = body_ports(body, scene([THRUST], [PROBE, RATE]), ["sensors"])
    np.testing.assert_allclose(ports.residuals[row(body, 6, 3), 0], 1.0)
    np.testing.assert_allclose(ports.residuals[row(body, 3, 5), 1], 1.0)
    assert np.count_nonzero(ports.residuals) == 2
    np.testing.assert_allclose(ports.static_loads, ports.residuals)
    assert ports.displacements.shape[0] == ports.rates.shape[0] == 1


def test_dampers_as_residuals_are_those_of_the_body_and_of_its_parameters():
    body = bar()
    own, other = (strut_damper(body, node) for node in (2, 4))
    body = replace(body, D=own, damping=Damping(), terms=(ParameterTerm("c", "D", other),))
    loads = body_ports(body, scene(), ["dampers"]).residuals
    for D in (own, other):
        wanted = D.toarray()
        assert abs(loads @ np.linalg.lstsq(loads, wanted)[0] - wanted).max() < 1e-12
    assert np.linalg.matrix_rank(loads) == 2


def strut_damper(body: FEModel, node: int) -> sp.csc_array:
    along = np.zeros((body.n, 1))
    along[[row(body, node, 1), row(body, node + 2, 1)], 0] = -1, 1
    return sp.csc_array(along @ along.T)


@pytest.mark.parametrize(
    ("text", "rows"),
    [("5.z", [(5, 3)]), ("5", [(5, c) for c in range(1, 7)]), ("root.rx", [(1, 4)])],
)
def test_residuals_at_a_node(text, rows):
    body = bar()
    ports = body_ports(body, scene([THRUST]), [text])
    expected = np.zeros((body.n, len(rows)))
    for column, (node, component) in enumerate(rows):
        expected[row(body, node, component), column] = 1.0
    np.testing.assert_allclose(ports.residuals, expected, atol=0)
    assert ports.interface.tolist() == body_ports(body, scene([THRUST])).interface.tolist()


def test_directions_are_those_of_the_basic_frame():
    """A node whose displacement axes are turned: a load along basic z has three components."""
    body = bar(axes=np.tile(TURN, (7, 1, 1)))
    ports = body_ports(body, scene([THRUST]), ["5.z"])
    where = body.dofs.rows(5, np.arange(1, 7))
    np.testing.assert_allclose(ports.residuals[where, 0], [*(TURN @ [0, 0, 1]), 0, 0, 0], atol=1e-15)
    assert sorted(ports.interface) == [*range(6), *body.dofs.rows(4, np.array([1, 2, 3]))]


def test_struts_are_one_load_each():
    body = bar()
    ports = body_ports(body, scene([strut("bar.2", "bar.5")]))
    assert ports.interface.tolist() == [*range(6)]
    expected = np.zeros(body.n)
    expected[row(body, 5, 1)], expected[row(body, 2, 1)] = 1.0, -1.0
    np.testing.assert_allclose(ports.loads[:, 0], expected, atol=1e-15)


def test_loads_take_the_place_of_an_interface_on_a_body_that_nothing_holds():
    body = replace(bar(), interfaces={})
    ports = body_ports(body, scene([THRUST, strut("bar.2", "bar.5")], [PROBE]), ["sensors"]).as_loads()
    assert ports.interface.size == 0
    assert ports.loads.shape == (body.n, 3) and ports.static_loads.shape == (body.n, 4)
    assert ports.loads[row(body, 4, 2), 0] == ports.loads[row(body, 4, 3), 1] == 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("99.z", r"'bar\.99': body 'bar' has no node or interface '99'"),
        ("5.q", r"'q' is no dof"),
        ("7.rx", r"'bar\.7\.rx': the node does not have this dof"),
    ],
)
def test_residuals_where_nothing_is_are_refused(text, message):
    whole = bar()
    keep = np.setdiff1d(np.arange(whole.n), whole.dofs.rows(7, np.array([4, 5, 6])))
    dofs = DofTable(whole.dofs.node[keep], whole.dofs.component[keep])
    body = FEModel("bar", whole.K[keep][:, keep], whole.M[keep][:, keep], dofs, whole.nodes, whole.interfaces)
    with pytest.raises(SceneError, match=message):
        body_ports(body, scene([THRUST]), [text])


# Shapes of a scene need more than one body.
@pytest.mark.parametrize("method", sorted(set(METHODS) - {SceneKrylov.method}))
def test_every_set_answers_its_residuals_statically(method):
    """Flexibility under a strut and a couple of opposite thrusters, that the interface knows nothing of."""
    body = bar()
    opposite = at("bar.4", "z", "up"), at("bar.6", "z", "down"), at("bar.5", "ry", "couple")
    ports = body_ports(body, scene([strut("bar.2", "bar.5"), *opposite]), ["actuators"])
    assert ports.loads.shape[1] == 4
    modal = orthogonalise(reduction(method, 40.0).reduce(body, ports.interface, ports.static_loads))
    # In balance: up and down, and the couple against their moment (0.5 m apart, z forces turn about -y).
    balanced = ports.loads @ np.array([[1.0, 0], [0, 1.0], [0, -1.0], [0, 0.5]])
    R = np.zeros((body.n, 2))
    R[[row(body, k, 3) for k in range(1, 8)], 0] = 1.0
    R[[row(body, k, 3) for k in range(1, 8)], 1] = -body.nodes.xyz[:, 0]
    R[[row(body, k, 5) for k in range(1, 8)], 1] = 1.0
    moment = R.T @ balanced
    balanced[row(body, 5, 5), 1] -= moment[1, 1]
    np.testing.assert_allclose(R.T @ balanced, 0, atol=1e-12)
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    exact = X[:, 6:] @ ((X[:, 6:].T @ balanced) / lam[6:, None])
    Phi, k = modal.Phi[:, 6:], modal.stiffness[6:]
    found = Phi @ ((Phi.T @ balanced) / k[:, None])
    energy = np.einsum("ij,ij->j", found - exact, body.K @ (found - exact))
    assert (energy < 1e-14 * np.einsum("ij,ij->j", exact, body.K @ exact)).all()
