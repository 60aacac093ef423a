"""What a neighbour adds on the interface of a body: condensed by hand, turned, moved, held and let go."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import (
    assemble,
    interface_substructure,
    neighbour_loading,
    physical_substructure,
    reduced_substructure,
    rigid_substructure,
    system_modes,
)
from cmsreduce.errors import ConstraintError
from cmsreduce.model import FEModel, InterfaceLoading, Joint, JointElement, Nodes, Placement, Point, Scene, Substructure
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import BenfieldHruda, Guyan
from tests.assemble.rigs import joint, physical, rigid_body, rigid_modes
from tests.frames import Section, frame, line, rotation

ELBOW = np.array([1.0, 0.4, 0.0])
TURN = rotation([0.3, -0.5, 0.8], 0.9)


def stator(**options) -> FEModel:
    return frame("stator", [[0, 0, 0], [0.5, 0.3, 0.1], ELBOW], [(1, 2), (2, 3)], {"elbow": 3}, **options)


def rotor(faces=None, **options) -> FEModel:
    xyz = [ELBOW, [1.4, 0.4, 0.0], [1.8, 0.2, 0.3]]
    return frame("rotor", xyz, [(1, 2), (2, 3)], faces or {"elbow": 1}, **options)


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def here(body: FEModel) -> Substructure:
    return interface_substructure(body, i_set(body), body.interfaces)


def condensed(body: FEModel) -> Substructure:
    return reduced_substructure(Guyan(0.0).reduce(body, i_set(body)), list(body.interfaces))


def by_hand(body: FEModel, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """psi^T K psi and psi^T M psi."""
    K, M = body.K.toarray(), body.M.toarray()
    j = np.setdiff1d(np.arange(body.n), rows)
    psi = np.zeros((body.n, rows.size))
    psi[rows] = np.eye(rows.size)
    psi[j] = -la.solve(K[np.ix_(j, j)], K[np.ix_(j, rows)])
    return psi.T @ K @ psi, psi.T @ M @ psi


def scene(*joints: Joint, **options) -> Scene:
    bodies = dict.fromkeys(point.body for link in joints for point in (link.first, link.second))
    return Scene(tuple(bodies), (0.0, 100.0), joints, **options)


def assert_close(found: np.ndarray, exact: np.ndarray, digits: float = 1e-9) -> None:
    np.testing.assert_allclose(found, exact, rtol=0, atol=digits * max(abs(exact).max(), 1e-300))


def moved(body: FEModel, place: Placement) -> FEModel:
    """The same body in a basic frame of its own, which ``place`` brings back."""
    nodes, Q = body.nodes, place.rotation
    xyz = (nodes.xyz - place.translation) @ Q
    faces = {
        name: replace(
            face,
            position=(face.position - place.translation) @ Q,
            frame=face.frame @ Q,
            node_axes=face.node_axes @ Q,
        )
        for name, face in body.interfaces.items()
    }
    return replace(body, nodes=Nodes(nodes.id, xyz, nodes.frame @ Q), interfaces=faces)


@pytest.mark.parametrize("free", ["", "rz", "rx ry rz"], ids=["weld", "hinge", "ball"])
@pytest.mark.parametrize("order", [1, -1], ids=["first", "second"])
def test_one_node_is_loaded_by_the_condensed_neighbour_whatever_the_joint_frees(free, order):
    """Every dof of the shared interface is loaded, those that the joint leaves free too."""
    neighbour = rotor(held=(3,))
    K, M = by_hand(neighbour, i_set(neighbour))
    assert abs(K).max() > 1e3
    ends = ["stator.elbow", "rotor.elbow"][::order]
    load = neighbour_loading(here(stator()), [condensed(neighbour)], scene(joint("j", *ends, free)))
    assert_close(load.K, K)
    assert_close(load.M, M)
    assert (load.neighbours, load.configuration, load.size) == (("rotor",), "as built", 6)


def test_a_free_neighbour_on_one_node_adds_its_rigid_mass_alone():
    neighbour = rotor()
    load = neighbour_loading(here(stator()), [condensed(neighbour)], scene(joint("j", "stator.elbow", "rotor.elbow")))
    _, M = by_hand(neighbour, i_set(neighbour))
    assert_close(load.M, M)
    assert abs(load.K).max() < 1e-12 * abs(neighbour.K).max()


def test_axes_of_nodes_and_placements_turn_the_loading():
    """Both bodies with node frames of their own, the neighbour drawn elsewhere and brought by `place`."""
    place = Placement(TURN, np.array([0.4, -2.0, 1.1]))
    axes = np.array([rotation([1, k, -2], 0.4 + k) for k in range(3)])
    turned = replace(moved(rotor(held=(3,), axes=axes), place))
    mine = np.array([rotation([k, 1, 1], 0.7 - k) for k in range(3)])
    body = stator(axes=mine)
    where = scene(joint("j", "stator.elbow", "rotor.elbow"), placements={"rotor": place})
    load = neighbour_loading(here(body), [condensed(turned)], where)
    K, M = by_hand(rotor(held=(3,)), i_set(rotor(held=(3,))))
    T = la.block_diag(mine[2], mine[2])
    assert_close(load.K, T @ K @ T.T)
    assert_close(load.M, T @ M @ T.T)


def test_an_offset_carries_the_loading_along_its_arm():
    arm = np.array([0.3, -0.2, 0.5])
    neighbour = rotor()
    away = Placement(np.eye(3), arm)
    where = scene(joint("j", "stator.elbow", "rotor.elbow", offset=tuple(arm)), placements={"rotor": away})
    load = neighbour_loading(here(stator()), [condensed(neighbour)], where)
    _, M = by_hand(neighbour, i_set(neighbour))
    x, y, z = arm
    T = np.eye(6)
    T[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert_close(load.M, T.T @ M @ T)


@pytest.mark.parametrize("length", [1.0, 1e3, 1e5])
def test_a_rigid_neighbour_far_from_its_interface(length):
    """Its parallel-axis mass matrix, in metres, in millimetres and beyond."""
    arm = np.array([3.0, -20.0, 5.0]) * length
    box = rigid_body("box", 4.0, ELBOW + arm, np.array([0.5, 0.6, 0.7]) * length**2, {"foot": ELBOW})
    load = neighbour_loading(here(stator()), [rigid_substructure(box)], scene(joint("j", "stator.elbow", "box.foot")))
    S = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    exact = np.block([[4.0 * np.eye(3), -4.0 * S], [4.0 * S, box.inertia - 4.0 * S @ S]])
    scale = np.r_[np.ones(3), np.full(3, length)]
    assert_close(load.M / np.outer(scale, scale), exact / np.outer(scale, scale))
    assert abs(load.K).max() == 0 and load.size == 6


def test_neighbours_add_up_each_on_its_own_interface():
    body = line("beam", [0, 0, 0], [1, 0, 0], 4)
    left = line("left", [0, 0, 0], [0, 1, 0], 3, interfaces={"foot": 1}, held=(4,))
    right = line("right", [1, 0, 0], [1, 0, 2], 3, interfaces={"foot": 1}, held=(4,))
    where = scene(joint("l", "beam.a", "left.foot"), joint("r", "right.foot", "beam.b", "rz"))
    load = neighbour_loading(here(body), [condensed(left), condensed(right)], where)
    pairs = [by_hand(other, i_set(other)) for other in (left, right)]
    assert_close(load.K, la.block_diag(pairs[0][0], pairs[1][0]))
    assert_close(load.M, la.block_diag(pairs[0][1], pairs[1][1]))
    assert load.neighbours == ("left", "right")


def test_a_neighbour_joined_twice():
    """Two joints between two bodies: the loading couples both interfaces."""
    body = line("beam", [0, 0, 0], [1, 0, 0], 4)
    bow = frame("bow", [[0, 0, 0], [0.5, 0.5, 0.2], [1, 0, 0]], [(1, 2), (2, 3)], {"a": 1, "b": 3})
    where = scene(joint("l", "beam.a", "bow.a"), joint("r", "beam.b", "bow.b"))
    load = neighbour_loading(here(body), [condensed(bow)], where)
    K, M = by_hand(bow, i_set(bow))
    assert_close(load.K, K)
    assert_close(load.M, M)
    assert abs(load.K[:6, 6:]).max() > 0.1 * abs(K).max()


def test_the_ground_holds_the_neighbour():
    neighbour = rotor({"elbow": 1, "tip": 3})
    where = replace(scene(joint("j", "stator.elbow", "rotor.elbow")), ground=(Point("rotor", "tip"),))
    load = neighbour_loading(here(stator()), [condensed(neighbour)], where)
    held = rotor(held=(3,))
    K, M = by_hand(held, i_set(held))
    assert_close(load.K, K)
    assert_close(load.M, M)


PIN = {"elbow": ((1,), (1, 2, 3))}


def test_a_pin_leaves_the_neighbour_rotations_of_its_own():
    """Rigid on a ball joint of translations only: three coordinates, and modes as assembled."""
    box = rigid_body("box", 4.0, [1.1, 0.6, 0.3], [0.5, 0.6, 0.7], {"foot": ELBOW}, dofs=(1, 2, 3))
    body = stator()
    pinned = replace(body, interfaces={"elbow": replace(body.interfaces["elbow"], components=((1, 2, 3),))})
    where = scene(joint("j", "stator.elbow", "box.foot", "rx ry rz"))
    load = neighbour_loading(here(pinned), [rigid_substructure(box)], where)
    assert load.size == 6 and abs(load.K).max() == 0
    # Whatever rotations the box makes, it resists a push at the pin by its effective mass there.
    effective = load.M[:3, :3] - load.M[:3, 3:] @ la.solve(load.M[3:, 3:], load.M[3:, :3])
    arm = np.array([0.1, 0.2, 0.3])
    S = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    assert_close(la.inv(effective), np.eye(3) / 4.0 - S @ la.inv(box.inertia) @ S)


@pytest.mark.parametrize("spin", [0.0, 0.6], ids=["rod", "box"])
def test_a_spin_without_inertia_is_none_of_its_coordinates(spin):
    """The spin is about the line through the pin, so that its inertia does not matter to the body."""
    rod, box = (
        rigid_body("rod", 4.0, [1.0, 0.7, 0.0], [0.5, J, 0.5], {"foot": ELBOW}, dofs=(1, 2, 3)) for J in (spin, 0.3)
    )
    body = stator()
    pinned = replace(body, interfaces={"elbow": replace(body.interfaces["elbow"], components=((1, 2, 3),))})
    where = scene(joint("j", "stator.elbow", "rod.foot", "rx ry rz"))
    load = neighbour_loading(here(pinned), [rigid_substructure(rod)], where)
    assert load.size == (5 if spin == 0 else 6)
    assert la.eigvalsh(load.M[3:, 3:])[0] > 0.1
    component = BenfieldHruda(500.0, load).reduce(pinned, i_set(pinned))
    subs = {"stator": physical(pinned), "rod": rigid_substructure(box)}
    w, _ = system_modes(assemble(subs, where, where.configurations[0]), 2 * np.pi * 500)
    loaded = component.modes.source_hz[[kind == "loaded" for kind in component.modes.kind]]
    assert w.size == 5
    np.testing.assert_allclose(loaded, w / (2 * np.pi), rtol=1e-7)


def test_what_the_neighbour_cannot_follow_is_refused():
    """A joint that locks a rotation which the neighbour was condensed without."""
    neighbour = rotor(PIN)
    subs = reduced_substructure(Guyan(0.0).reduce(neighbour, np.r_[0:3, 6:12]), ["elbow"])
    body = stator()
    lost = replace(subs, motion={"1": np.vstack([subs.motion["1"][:2], np.zeros((4, subs.m))])})
    pinned = replace(body, interfaces={"elbow": replace(body.interfaces["elbow"], components=((1, 2, 3),))})
    with pytest.raises(
        ConstraintError,
        match=r"'rotor' cannot load 'stator': it cannot follow a motion of the interface that their joints lock",
    ):
        neighbour_loading(here(pinned), [lost], scene(joint("j", "stator.elbow", "rotor.elbow", "rx ry rz")))


@pytest.mark.parametrize("free", ["", "ry"], ids=["weld", "hinge"])
def test_modes_loaded_by_a_neighbour_without_inner_mass_are_those_of_the_assembly(free):
    """Condensation is exact where the neighbour has mass at the joint alone: as the two bodies assembled, welded."""
    light = rotor(held=(3,), section=Section(rho=0.0), masses={1: 2.5})
    body = stator()
    where = scene(joint("j", "stator.elbow", "rotor.elbow", free))
    load = neighbour_loading(here(body), [condensed(light)], where)
    component = BenfieldHruda(400.0, load).reduce(body, i_set(body))
    whole = scene(joint("j", "stator.elbow", "rotor.elbow"))
    subs = {"stator": physical(body), "rotor": physical_substructure(light, ["elbow"], rigid_modes(light))}
    system = assemble(subs, whole, whole.configurations[0])
    w, shapes = system_modes(system, 2 * np.pi * 400)
    assert system.rigid.shape[1] == 0 and w.size > 5
    # Each shape of the assembly, on the body, is in the span.
    inside = (np.asarray(system.T.todense() if hasattr(system.T, "todense") else system.T) @ shapes)[: body.n]
    modal = orthogonalise(component)
    missed = inside - modal.Phi @ (modal.Phi.T @ (body.M @ inside))
    size = np.sqrt(np.einsum("ij,ij->j", inside, body.M @ inside))
    assert (np.sqrt(np.einsum("ij,ij->j", missed, body.M @ missed)) < 1e-7 * size).all()


def test_the_loading_is_symmetric_and_positive():
    neighbour = rotor({"elbow": 1, "tip": 3})
    where = scene(joint("j", "stator.elbow", "rotor.elbow"))
    load = neighbour_loading(here(stator()), [condensed(neighbour)], where)
    assert isinstance(load, InterfaceLoading)
    # The tip is not held by the interface: six motions of it are coordinates.
    assert load.size == 12
    for A in (load.K, load.M):
        assert (A == A.T).all() and la.eigvalsh(A)[0] > -1e-12 * la.eigvalsh(A)[-1]


@pytest.mark.parametrize("order", [1, -1], ids=["ours", "the neighbour's"])
def test_a_joints_own_inertia_is_part_of_the_loading_once(order):
    """Held in the loading, the joint's spring is not strained and its inertia turns with both sides."""
    ends = ["stator.elbow", "rotor.elbow"][::order]
    bare = joint("j", *ends, "rz")
    plain = neighbour_loading(here(stator()), [condensed(rotor())], scene(bare))
    link = replace(bare, elements=(JointElement(5, 900.0, 3.0, 0.6),))
    load = neighbour_loading(here(stator()), [condensed(rotor())], scene(link))
    exact = np.zeros((6, 6))
    exact[5, 5] = 0.6
    assert_close(load.M - plain.M, exact, 1e-12)
    assert_close(load.K, plain.K, 1e-9)


def test_a_spring_on_a_motion_that_stays_free_loads_the_body():
    """A ball joint of three translations on our side, of six dofs on the neighbour's."""
    box = rigid_body("box", 4.0, [1.1, 0.6, 0.3], [0.5, 0.6, 0.7], {"foot": ELBOW})
    body = stator()
    pinned = replace(body, interfaces={"elbow": replace(body.interfaces["elbow"], components=((1, 2, 3, 6),))})
    link = joint("j", "stator.elbow", "box.foot", "rx ry rz", elements=(JointElement(5, 50.0, 0.0, 0.2),))
    loose = replace(link, elements=())
    load, plain = (neighbour_loading(here(pinned), [rigid_substructure(box)], scene(each)) for each in (link, loose))
    # On our own turn about z and on the box's: k [1 -1; -1 1], and the inertia on our side.
    assert abs(load.K[3, 3] - 50.0) < 1e-12 and np.linalg.matrix_rank(load.K, tol=1e-9) == 1
    added = load.M - plain.M
    assert abs(added[3, 3] - 0.2) < 1e-12 and np.linalg.matrix_rank(added, tol=1e-9) == 1
