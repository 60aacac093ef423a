"""What coordinates cost in an assembled system: sums against scipy's Lyapunov solver, and what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import quad_vec

from cmsreduce.assemble import (
    assemble,
    elastic_states,
    modal_substructure,
    physical_substructure,
    rigid_substructure,
)
from cmsreduce.balance import component_costs, keep_total
from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, Damping, DofTable, FEModel, ModalChannels, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.project import Shares, largest_shares, system_cost
from cmsreduce.reduce import CraigBampton
from tests.assemble.rigs import at, in_joint, joint, rigid_body
from tests.frames import line

AS_BUILT = Configuration("as built")
LAWS = {"uncoupled": Damping(rayleigh=(0.0, 1e-4)), "coupled": Damping(modal=0.02)}
PUSH, TWIST = at("arm.a", [0, 1, 1, 0, 0, 0], "push"), in_joint("hinge", "ry")
SENSORS = (at("panel.b", "z"), at("hub.cg", "rz", rate=True))


def bodies(law: Damping):
    arm = line("arm", [0, 0, 0], [1, 0, 0], 4, damping=law)
    panel = line("panel", [1, 0, 0], [1.4, 0.5, 0.1], 3, damping=law)
    hub = rigid_body("hub", 2.0, [-0.1, 0, 0.02], [0.02, 0.03, 0.025], {"face": [0, 0, 0]})
    return arm, panel, hub


def modal(body, cutoff=2000.0):
    rows = np.concatenate([body.interface_rows(name) for name in body.interfaces])
    return orthogonalise(CraigBampton(cutoff).reduce(body, rows))


def study(law: Damping, sensors=SENSORS, actuators=(PUSH, TWIST)):
    arm, panel, hub = bodies(law)
    components = {"arm": modal(arm), "panel": modal(panel)}
    subs = {name: modal_substructure(component, ["a", "b"]) for name, component in components.items()}
    subs["hub"] = rigid_substructure(hub)
    joints = (joint("weld", "hub.face", "arm.a"), joint("hinge", "arm.b", "panel.a", "ry"))
    scene = Scene(tuple(subs), (0.0, 100.0), joints, actuators=actuators, sensors=sensors)
    return assemble(subs, scene, AS_BUILT), subs, components


def mean_square(system, noise=(1.0, 1.0), weight=(1.0, 1.0)) -> float:
    """tr(Q C X C^T) by scipy."""
    states = elastic_states(system)
    X = la.solve_continuous_lyapunov(states.A, -states.B @ np.diag(noise) @ states.B.T)
    return float(np.trace(np.diag(weight) @ states.C @ X @ states.C.T))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("noise", "weight"), [((1.0, 1.0), (1.0, 1.0)), ((4.0, 0.1), (100.0, 0.5))])
def test_shares_sum_to_the_mean_square(law, noise, weight):
    system, subs, _ = study(LAWS[law])
    cost = system_cost(system, subs, np.array(noise), np.array(weight))
    V = mean_square(system, noise, weight)
    assert cost.total == pytest.approx(V, rel=1e-9)
    assert cost.modes.sum() == pytest.approx(V, rel=1e-9)
    assert sum(share.sum() for share in cost.coordinates.values()) == pytest.approx(V, rel=1e-9)
    assert {name: share.size for name, share in cost.coordinates.items()} == system.sizes


def test_a_body_alone_costs_what_it_costs_by_itself():
    arm = bodies(LAWS["coupled"])[0]
    component = modal(arm)
    subs = {"arm": modal_substructure(component, ["a", "b"])}
    system = assemble(subs, Scene(("arm",), (0.0, 100.0), (), actuators=(PUSH,), sensors=(at("arm.b", "y"),)), AS_BUILT)
    e = component.elastic
    B, C = system.T @ system.B, system.C1 @ system.T.T
    alone = ModalChannels(
        "arm", component.omega[e], component.zeta[e], B[e], C[:, e], np.zeros((1, component.elastic_count))
    )
    np.testing.assert_allclose(
        system_cost(system, subs).coordinates["arm"][e], component_costs(alone), rtol=1e-8, atol=0
    )


def test_the_side_of_a_joint_that_a_sensor_is_on_does_not_matter():
    shares = []
    for point in ("arm.b", "panel.a"):
        system, subs, _ = study(LAWS["coupled"], (at(point, "y"),))
        shares.append(system_cost(system, subs))
    for name, share in shares[0].coordinates.items():
        np.testing.assert_allclose(shares[1].coordinates[name], share, rtol=0, atol=1e-9 * shares[0].total)


def test_the_scale_of_coordinates_does_not_matter():
    system, subs, _ = study(LAWS["coupled"])
    cost = system_cost(system, subs)
    S = np.diag(np.geomspace(1e-3, 1e3, subs["panel"].m))
    panel = subs["panel"]
    square = {letter: sp.csc_array(S @ getattr(panel, letter) @ S) for letter in ("M", "K", "D")}
    motion = {label: rows @ S for label, rows in panel.motion.items()}
    scaled = replace(panel, **square, rigid=np.linalg.solve(S, panel.rigid), motion=motion, omega=None)
    joints = (joint("weld", "hub.face", "arm.a"), joint("hinge", "arm.b", "panel.a", "ry"))
    scene = Scene(tuple(subs), (0.0, 100.0), joints, actuators=(PUSH, TWIST), sensors=SENSORS)
    others = {**subs, "panel": scaled}
    again = system_cost(assemble(others, scene, AS_BUILT), others)
    for name, share in cost.coordinates.items():
        np.testing.assert_allclose(again.coordinates[name], share, rtol=0, atol=1e-7 * cost.total)


def test_the_costliest_modes_of_all_bodies_are_chosen():
    system, subs, components = study(LAWS["coupled"])
    cost = system_cost(system, subs)
    found = {}
    for name, component in components.items():
        sigma = largest_shares([cost], name, np.arange(component.omega.size)[:, None])
        found[name] = replace(component, sigma=sigma)
    kept = keep_total(found, 5)
    assert sum(columns.size for columns in kept.values()) == 5
    left_out = [
        abs(cost.coordinates[name][np.setdiff1d(np.arange(c.elastic.start, c.elastic.stop), kept[name])]).max()
        for name, c in components.items()
    ]
    chosen = [abs(cost.coordinates[name][columns]).min() for name, columns in kept.items() if columns.size]
    assert max(left_out) <= min(chosen)


def test_a_group_of_coordinates_counts_by_the_sum_of_its_shares_at_the_worst_configuration():
    costs = [
        Shares(2.0, {"a": np.array([1.5, -0.5, 1.0])}),
        Shares(0.0, {"a": np.ones(3)}),
    ]
    costs.append(Shares(10.0, {"a": np.array([0.0, 4.0, 6.0])}))
    np.testing.assert_allclose(largest_shares(costs, "a", [np.array([0, 1]), np.array([2])]), [0.5, 0.6])


def dragged(law: str, drag: tuple[float, ...]):
    """A hinge with drag and no spring; further figures resist rigid motions of the whole."""
    sensors = (*SENSORS, in_joint("hinge", "ry", rate=True))
    system, subs, _ = study(LAWS[law], sensors)
    hinge = system.C2[[2]].T
    # Rigid motions of the whole leave the hinge at rest, whatever basis they come in.
    whole = system.rigid @ la.null_space(hinge.T @ system.rigid)
    rows = [hinge, *(dense(system.M @ whole[:, [k]]) for k in range(len(drag) - 1))]
    return replace(system, D=dense(system.D) + sum(d * row @ row.T for d, row in zip(drag, rows, strict=True))), subs


def stable_mean_square(system) -> float:
    """By scipy, of the equations of motion without the states that wander: rigid displacements, free rates."""
    M, K, D = dense(system.M), dense(system.K), dense(system.D)
    drag, V = la.eigh(system.rigid.T @ D @ system.rigid)
    rigid, b = system.rigid @ V[:, ::-1], np.count_nonzero(drag > 1e-9 * drag[-1])
    rest = la.null_space(rigid.T @ M)
    w2, X = la.eigh(rest.T @ K @ rest, rest.T @ M @ rest)
    Phi, e = rest @ X, w2.size
    rates = np.hstack([Phi, rigid[:, :b]])
    damped, w = rates.T @ D @ rates, np.sqrt(w2)
    A = np.zeros((2 * e + b, 2 * e + b))
    A[:e, e : 2 * e], A[e : 2 * e, :e], A[e:, e:] = np.diag(w), -np.diag(w), -damped
    B = np.vstack([np.zeros((e, system.B.shape[1])), rates.T @ system.B])
    C = np.hstack([system.C1 @ Phi / w, system.C2 @ rates])
    assert la.eigvals(A).real.max() < 0
    return float(np.trace(C @ la.solve_continuous_lyapunov(A, -B @ B.T) @ C.T))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("drag", [(0.4,), (1e-4,), (0.4, 3.0), (0.4, 3.0, 0.02)], ids=str)
def test_rates_that_drag_resists_count_and_displacements_that_wander_do_not(law, drag):
    system, subs = dragged(law, drag)
    cost = system_cost(system, subs)
    V = stable_mean_square(system)
    assert cost.damped_rigid.size == len(drag) and cost.damped_rigid.sum() > 0
    assert cost.total == pytest.approx(V, rel=1e-8)
    assert cost.modes.sum() + cost.damped_rigid.sum() == pytest.approx(V, rel=1e-8)
    assert sum(share.sum() for share in cost.coordinates.values()) == pytest.approx(V, rel=1e-8)


def test_a_rigid_wheel_with_drag_has_the_mean_square_of_brownian_motion():
    """By hand: J v' + d v = u under unit noise has <v^2> = 1 / (2 d J)."""
    J, d = 0.3, 0.07
    wheel = rigid_body("wheel", 1.0, [0, 0, 0], [1, 1, J], {"face": [0, 0, 0]})
    subs = {"wheel": rigid_substructure(wheel)}
    sensors = (at("wheel.cg", "rz", "rate", rate=True), at("wheel.cg", "rz", "angle"))
    scene = Scene(("wheel",), (0.0, 1.0), (), actuators=(at("wheel.cg", "rz"),), sensors=sensors)
    system = assemble(subs, scene, AS_BUILT)
    turn = system.B
    cost = system_cost(replace(system, D=d * turn @ turn.T), subs)
    assert cost.total == pytest.approx(1 / (2 * d * J), rel=1e-12)
    np.testing.assert_allclose(cost.coordinates["wheel"], [0, 0, 0, 0, 0, cost.total], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("law", "error", "words"),
    [
        (Damping(), DampingError, "needs positive damping"),
        (Damping(structural=0.01), MatrixError, "complex stiffness"),
    ],
)
def test_what_has_no_mean_square_is_refused(law, error, words):
    system, subs, _ = study(law)
    with pytest.raises(error, match=words):
        system_cost(system, subs)


def dashpots(constants, held=True):
    """Four masses and two points without mass in a chain of springs; dashpots from these points to the ground."""
    n, massless = 6, [1, 4]
    K = np.diag(np.r_[2.0 if held else 1.0, 2, 2, 2, 2, 1]) - np.eye(n, k=1) - np.eye(n, k=-1)
    M = np.diag([1.0, 0, 2, 0.5, 0, 1])
    D = 0.01 * K
    D[massless, massless] += constants
    body = FEModel("chain", sp.csc_array(K), sp.csc_array(M), DofTable(np.arange(1, n + 1), np.zeros(n, dtype=int)))
    rigid = np.empty((n, 0)) if held else np.full((n, 1), 1 / np.sqrt(np.trace(M)))
    subs = {"chain": replace(physical_substructure(body, [], rigid), D=D)}
    system = assemble(subs, Scene(("chain",), (0.0, 1.0), ()), AS_BUILT)
    rows = np.zeros((3, n))
    rows[0, 0], rows[1, 4], rows[2, 1] = 1.0, 1.0, 1.0
    B = np.zeros((n, 2))
    B[5, 0], B[0, 1] = 1.0, 0.3
    # A displacement, the displacement of a point without mass, and the rate of one.
    measured = np.array([[1.0], [1.0], [0.0]])
    system = replace(system, B=system.T.T @ B, C1=measured * (rows @ system.T), C2=(1 - measured) * (rows @ system.T))
    return replace(system, inputs=("a", "b"), outputs=("x", "y", "z")), subs


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("constants", [(0.3, 3.0), (1e-3, 40.0), (2.0, 0.0)])
def test_points_without_mass_behind_dashpots_lag(constants, held):
    """A Maxwell element adds stiffness at high frequencies, which damping of the modes with mass does not have."""
    system, subs = dashpots(constants, held)
    if not held:
        # Displacements wander.
        system = replace(system, C1=0 * system.C1, C2=system.C1 + system.C2)
    K, M, D = (dense(A) for A in (system.K, system.M, system.D))

    def square(w):
        H = (system.C1 + 1j * w * system.C2) @ la.solve(K + 1j * w * D - w**2 * M, system.B)
        return np.sum(abs(H) ** 2) / np.pi

    V = quad_vec(square, 1e-9, np.inf, epsrel=1e-10, points=np.geomspace(0.01, 10, 50), limit=10**5)[0]
    cost = system_cost(system, subs)
    parts = cost.modes.sum() + cost.damped_rigid.sum() + cost.lagging.sum()
    assert cost.lagging.size == 2 and abs(cost.lagging).max() > 1e-3 * V and cost.damped_rigid.size == 1 - held
    assert [cost.total, parts, cost.coordinates["chain"].sum()] == pytest.approx([V] * 3, rel=1e-6)
