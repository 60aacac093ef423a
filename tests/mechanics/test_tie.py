"""Tied interfaces: closed forms of a cantilever, constrained equations solved directly, rigid motion, mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.errors import SceneError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.mechanics import Tie, places_by_stiffness, rigid_mass, tie_nodes
from cmsreduce.model import DofTable, FEModel, Interface, Nodes, Units, cross_matrix, in_units, rigid_body_shapes
from cmsreduce.verify import rigid_mass_properties
from tests.frames import line, rotation
from tests.solids import RHO, E, block, face

LENGTH, HEIGHT, WIDTH = 0.5, 0.1, 0.15
CELLS = (40, 2, 2)
FREE = block("bar", (LENGTH, HEIGHT, WIDTH), (6, 2, 2), {"end": face((6, 2, 2), 6), "start": face((6, 2, 2), 0)})
TURNED = rotation([1, 2, 3], 0.7)
KINDS = ["rigid", "average"]


@pytest.fixture(scope="module")
def cantilever() -> FEModel:
    return block("bar", (LENGTH, HEIGHT, WIDTH), CELLS, {"end": face(CELLS, CELLS[0])}, held=face(CELLS, 0))


def point_rows(body: FEModel) -> np.ndarray:
    return body.interface_rows("end")


def tip_flexibility(body: FEModel) -> np.ndarray:
    """Motion of the tie's point under unit forces and moments there (6, 6)."""
    F = np.zeros((body.n, 6))
    F[point_rows(body), np.arange(6)] = 1.0
    return spla.splu(body.K).solve(F)[point_rows(body)]


def spread(body: FEModel, position: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Forces on the nodes of ``end`` under unit forces and moments at a point (n, 6).

    A force is shared by the weights; its moment about their centre, and a moment, by forces w_i (J^-1 m) x r_i, where J
    is the inertia of the weights: the textbook distribution of loads over a bolt group.
    """
    at = body.interfaces["end"].position
    centre = weights @ at / weights.sum()
    r = at - centre
    J = sum(w * (a @ a * np.eye(3) - np.outer(a, a)) for w, a in zip(weights, r, strict=True))
    F = np.zeros((body.n, 6))
    moment = np.hstack([cross_matrix(position - centre), np.eye(3)])
    for node, w, a in zip(body.interfaces["end"].node, weights, r, strict=True):
        rows = body.dofs.rows_of(int(node), (1, 2, 3))
        share = np.hstack([w / weights.sum() * np.eye(3), np.zeros((3, 3))])
        frame = body.nodes.frame[body.nodes.index(node)[0]]
        F[rows] = frame @ (share - w * cross_matrix(a) @ np.linalg.inv(J) @ moment)
    return F


def lagrange(body: FEModel, position: np.ndarray) -> np.ndarray:
    """Flexibility at a point that the nodes of ``end`` follow rigidly, by multipliers: K u + C^T l = 0, C u = R q."""
    face_dofs = body.interface_rows("end")
    R = rigid_body_shapes(body.dofs, body.nodes, position)[face_dofs]
    c = face_dofs.size
    C = sp.csc_array((np.ones(c), (np.arange(c), face_dofs)), shape=(c, body.n))
    size = abs(body.K).max()
    A = sp.block_array(
        [
            [body.K / size, None, C.T],
            [None, sp.csc_array((6, 6)), sp.csc_array(-R.T)],
            [C, sp.csc_array(-R), None],
        ],
        format="csc",
    )
    b = np.zeros((A.shape[0], 6))
    b[body.n : body.n + 6] = np.eye(6) / size
    return spla.splu(A).solve(b)[body.n : body.n + 6]


@pytest.mark.parametrize("kind", KINDS)
def test_a_tied_body_keeps_short_indices(cantilever, kind):
    """Half as much memory as of long ones, and no copy of them in each product and factor."""
    tied = tie_nodes(cantilever, "end", Tie(kind))
    assert cantilever.K.indices.dtype == np.int32
    assert {A.indices.dtype for A in (tied.K, tied.M, tied.tied.T)} == {np.dtype(np.int32)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_tied_cantilever_bends_as_a_beam(cantilever, kind):
    """Cubic bending with Timoshenko's shear; bricks of this shape are 2 % too stiff in bending.

    In the average each node weighs what the area around it does, as an even traction would load it.
    """
    areas = (1.0, 2.0, 1.0, 2.0, 4.0, 2.0, 1.0, 2.0, 1.0)
    C = tip_flexibility(tie_nodes(cantilever, "end", Tie(kind, weights=areas if kind == "average" else None)))
    area, G = HEIGHT * WIDTH, E / 2
    Iz, Iy = WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
    shear = LENGTH / (5 / 6 * G * area)
    assert C[0, 0] == pytest.approx(LENGTH / (E * area), rel=2e-3)
    assert C[1, 1] == pytest.approx(LENGTH**3 / (3 * E * Iz) + shear, rel=0.04)
    assert C[2, 2] == pytest.approx(LENGTH**3 / (3 * E * Iy) + shear, rel=0.03)
    assert C[5, 5] == pytest.approx(LENGTH / (E * Iz), rel=0.04)
    assert C[4, 4] == pytest.approx(LENGTH / (E * Iy), rel=0.03)
    assert C[1, 5] == pytest.approx(LENGTH**2 / (2 * E * Iz), rel=0.04)
    assert C[2, 4] == pytest.approx(-(LENGTH**2) / (2 * E * Iy), rel=0.03)


@pytest.mark.parametrize("position", [None, [LENGTH + 0.2, 0.3, -0.1]], ids=["centroid", "offset"])
def test_a_rigid_tie_solves_the_constrained_equations(cantilever, position):
    at = cantilever.interfaces["end"].position.mean(axis=0) if position is None else np.array(position)
    tied = tie_nodes(cantilever, "end", Tie("rigid", None if position is None else at))
    np.testing.assert_allclose(tied.interfaces["end"].position, [at], atol=1e-15)
    expected = lagrange(cantilever, at)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(tip_flexibility(tied) / scale, expected / scale, atol=1e-9)


@pytest.mark.parametrize("weighted", [False, True], ids=["equal", "weighted"])
@pytest.mark.parametrize("position", [None, [LENGTH + 0.2, 0.3, -0.1]], ids=["centroid", "offset"])
def test_an_average_spreads_a_load_statically_equivalent(cantilever, position, weighted):
    count = cantilever.interfaces["end"].node.size
    weights = np.linspace(1, 3, count) if weighted else np.ones(count)
    at = cantilever.interfaces["end"].position.mean(axis=0) if position is None else np.array(position)
    tied = tie_nodes(
        cantilever, "end", Tie("average", None if position is None else at, tuple(weights) if weighted else None)
    )
    assert tied.n == cantilever.n
    F = spread(cantilever, at, weights)
    # The forces on the nodes have the same resultant as the forces on the point.
    R = rigid_body_shapes(cantilever.dofs, cantilever.nodes, at)
    np.testing.assert_allclose(R.T @ F, np.eye(6), atol=1e-12)
    u = spla.splu(cantilever.K).solve(F)
    # By reciprocity the work of the loads gives the motion of the point.
    expected = F.T @ u
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(tip_flexibility(tied) / scale, expected / scale, atol=1e-9)
    # And every node, those that gave up a row included, as under the loads themselves.
    load = np.zeros((tied.n, 6))
    load[point_rows(tied), np.arange(6)] = 1.0
    every = tied.recovery
    at_nodes = every.dofs.rows(cantilever.dofs.node, cantilever.dofs.component)
    found = (every.T @ spla.splu(tied.K).solve(load))[at_nodes]
    np.testing.assert_allclose(found, u, atol=1e-9 * abs(u).max())


def elastic(body: FEModel) -> np.ndarray:
    """Squares of the elastic natural frequencies."""
    return la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:]


def test_an_average_stiffens_nothing_and_a_rigid_tie_does():
    free = elastic(FREE)
    average, rigid = (tie_nodes(FREE, "end", Tie(kind)) for kind in ("average", "rigid"))
    np.testing.assert_allclose(elastic(average), free, rtol=1e-7)
    stiff = elastic(rigid)
    assert rigid.n == FREE.n - 27 + 6
    # The bar's plane section bends as before, but it can no longer warp: the third mode is torsion.
    assert (stiff >= free[: stiff.size] * (1 - 1e-9)).all()
    assert stiff[2] > free[2] * (1 + 1e-3)


@pytest.mark.parametrize("axes", [None, TURNED], ids=["basic", "displacement frame"])
@pytest.mark.parametrize("frame", [None, rotation([0, 1, 1], 1.1)], ids=["basic", "frame"])
@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motion_and_mass_are_kept(kind, frame, axes):
    body = block("bar", (0.5, 0.1, 0.15), (4, 1, 2), {"end": face((4, 1, 2), 4)}, origin=(1, -2, 3), axes=axes)
    body = replace(body, D=sp.csc_array(2.0 * body.M))
    tied = tie_nodes(body, "end", Tie(kind, np.array([1.7, -1.8, 3.0]), frame=frame))
    R = rigid_body_shapes(tied.dofs, tied.nodes)
    assert abs(tied.K @ R).max() < 1e-12 * abs(tied.K).max() * abs(R).max()
    before, after = rigid_mass_properties(rigid_mass(body)), rigid_mass_properties(rigid_mass(tied))
    np.testing.assert_allclose(after.mass, 0.5 * 0.1 * 0.15 * RHO, rtol=1e-12)
    np.testing.assert_allclose(after.cg, [1.25, -1.95, 3.075], rtol=1e-12)
    np.testing.assert_allclose(after.inertia, before.inertia, atol=1e-11 * abs(before.inertia).max())
    np.testing.assert_allclose(tied.D.toarray(), 2 * tied.M.toarray(), rtol=1e-12)
    # Recovery takes rigid motion to rigid motion, at the nodes without rows as well.
    every = tied.recovery
    np.testing.assert_allclose(every.T @ R, rigid_body_shapes(every.dofs, tied.nodes), atol=1e-12)
    added = {f"{tied.interfaces['end'].node[0]}.{c}" for c in range(1, 7)}
    assert set(every.dofs.labels) == {*body.dofs.labels} | added
    expected = np.eye(3) if frame is None else frame
    np.testing.assert_array_equal(tied.interfaces["end"].frame, expected)


def test_two_ties_one_after_the_other_and_in_other_units():
    """In either order, in millimetres before or after: the same body."""
    one = tie_nodes(tie_nodes(FREE, "end", Tie("rigid")), "start", Tie("average"))
    two = tie_nodes(tie_nodes(FREE, "start", Tie("average")), "end", Tie("rigid"))
    assert [int(one.interfaces[name].node[0]) for name in ("end", "start")] == [64, 65]
    np.testing.assert_allclose(elastic(two), elastic(one), rtol=1e-8)
    units = Units.parse("mm-t-s")
    before = tie_nodes(tie_nodes(in_units(FREE, units), "end", Tie("rigid")), "start", Tie("average"))
    after = in_units(one, units)
    for body in (before, after):
        np.testing.assert_allclose(elastic(body), elastic(one), rtol=1e-8)
        every = body.recovery
        R = rigid_body_shapes(body.dofs, body.nodes)
        np.testing.assert_allclose(every.T @ R, rigid_body_shapes(every.dofs, body.nodes), atol=1e-9)
    # Of six dofs among equals any choice is good, but the nodes that follow rigidly are the same.
    rigid = [tie_nodes(FREE, "end", Tie("rigid")), tie_nodes(in_units(FREE, units), "end", Tie("rigid"))]
    expected = in_units(rigid[0], units)
    np.testing.assert_allclose(rigid[1].K.toarray(), expected.K.toarray(), atol=1e-12 * abs(expected.K).max())
    np.testing.assert_allclose(rigid[1].tied.T.toarray(), expected.tied.T.toarray(), atol=1e-10)


def test_one_node_with_rotations_carries_an_arm():
    """A rigid arm from the tip of a beam: deflection and slope at its far end follow from the tip."""
    beam = line("beam", [0, 0, 0], [1, 0, 0], 4, interfaces={"end": 5}, held=[1])
    arm = np.array([0.0, 0.3, 0.0])
    tied = tie_nodes(beam, "end", Tie("rigid", np.array([1.0, 0.3, 0.0])))
    carry = np.eye(6)
    carry[:3, 3:] = -cross_matrix(arm)
    F = np.zeros((beam.n, 6))
    F[beam.interface_rows("end"), np.arange(6)] = 1.0
    tip = spla.splu(beam.K).solve(F)[beam.interface_rows("end")]
    np.testing.assert_allclose(tip_flexibility(tied), carry @ tip @ carry.T, rtol=1e-9, atol=1e-12)


def test_a_set_that_loses_rows_is_gone_and_others_are_renumbered():
    body = replace(FREE, sets={"b": FREE.interface_rows("start"), "c": FREE.interface_rows("end")})
    tied = tie_nodes(body, "start", Tie("rigid"))
    assert list(tied.sets) == ["c"]
    labels = [FREE.dofs.labels[row] for row in FREE.interface_rows("end")]
    assert [tied.dofs.labels[row] for row in tied.sets["c"]] == labels


def nodes_of(*members: int, parts: tuple[int, ...] = (1, 2, 3)) -> dict[str, Interface]:
    ids = np.array(members)
    return {"end": Interface("end", ids, (parts,) * ids.size, FREE.nodes.xyz[ids - 1], np.eye(3))}


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("kind", KINDS)
def test_no_unit_of_length_decides_whether_nodes_are_in_line(kind, length):
    """The nodes of a straight beam tied by their translations alone: its rotation about itself stays undetermined."""
    beam = replace(line("beam", [0, 0, 0], [1, 0, 0], 4), units=Units("m-kg-s", 1.0, 1.0, 1.0))
    beam = in_units(beam, Units("other", 1 / length, 1.0, 1.0))
    ids = np.array([1, 3, 5])
    ends = Interface("end", ids, ((1, 2, 3),) * 3, beam.nodes.xyz[ids - 1], np.eye(3))
    with pytest.raises(SceneError, match="in line"):
        tie_nodes(replace(beam, interfaces={"end": ends}), "end", Tie(kind))


@pytest.mark.parametrize(("off", "refused"), [(1e-3, False), (3e-5, True)])
def test_nodes_so_nearly_in_line_that_digits_would_be_lost_are_refused(off, refused):
    faces = nodes_of(1, 2, 3)
    at = FREE.nodes.xyz.copy()
    at[1] += off * np.linalg.norm(at[2] - at[0]) * np.array([1.0, 0.0, 0.0])
    body = replace(FREE, nodes=replace(FREE.nodes, xyz=at), interfaces=faces)
    if refused:
        with pytest.raises(SceneError, match="in line"):
            tie_nodes(body, "end", Tie("average"))
        return
    # Nothing is stiffened: the frequencies are those of the body, but for digits that the lever costs.
    np.testing.assert_allclose(elastic(tie_nodes(body, "end", Tie("average"))), elastic(FREE), rtol=1e-6)


@pytest.mark.parametrize(
    ("body", "tie", "message"),
    [
        (
            replace(FREE, interfaces=nodes_of(1, 2, 3)),
            Tie("rigid"),
            "nodes 1, 2, 3 are in line",
        ),
        (replace(FREE, interfaces=nodes_of(1, 2, 3)), Tie("average"), "nodes 1, 2, 3 are in line"),
        (replace(FREE, interfaces=nodes_of(1, 2)), Tie("average"), "nodes 1, 2 are in line"),
        (replace(FREE, interfaces=nodes_of(7)), Tie("rigid"), "node 7 is alone"),
        (replace(FREE, interfaces=nodes_of(1, 3, 9, parts=(2, 3))), Tie("rigid"), "nodes 1, 3, 9 have too few dofs"),
        (FREE, Tie("average", weights=(1.0, 2.0)), "9 nodes need as many positive weights"),
        (FREE, Tie("average", weights=(0.0,) * 9), "9 nodes need as many positive weights"),
        (replace(FREE, nodes=None), Tie("rigid"), "give `geometry:`"),
        (
            replace(FREE, interfaces={**nodes_of(1, 3, 9), "other": FREE.interfaces["start"]}),
            Tie("rigid"),
            "nodes 1, 3, 9 are tied here and belong to interface 'start' too",
        ),
        (
            replace(tie_nodes(FREE, "start", Tie("average")), interfaces=nodes_of(1, 3, 9)),
            Tie("rigid"),
            "tied already; a node follows one point only",
        ),
    ],
)
def test_what_cannot_be_tied_is_refused(body, tie, message):
    with pytest.raises(SceneError, match=rf"body 'bar', interface 'end': .*{message}"):
        tie_nodes(body, "end", tie)


def test_nodes_that_are_partly_held_cannot_follow():
    keep = np.flatnonzero((FREE.dofs.node != FREE.interfaces["end"].node[0]) | (FREE.dofs.component != 2))
    parts = ((1, 3), *FREE.interfaces["end"].components[1:])
    body = without_rows(keep, parts)
    with pytest.raises(SceneError, match=r"nodes 55 lack translations that others have"):
        tie_nodes(body, "end", Tie("rigid"))
    with pytest.raises(SceneError, match=r"an average needs .* nodes 55 lack some"):
        tie_nodes(body, "end", Tie("average"))


def without_rows(keep: np.ndarray, parts: tuple[tuple[int, ...], ...]) -> FEModel:
    dofs = DofTable(FREE.dofs.node[keep], FREE.dofs.component[keep])
    faces = {"end": replace(FREE.interfaces["end"], components=parts)}
    return replace(FREE, K=FREE.K[keep][:, keep], M=FREE.M[keep][:, keep], dofs=dofs, interfaces=faces)


def test_coincident_nodes_are_refused():
    xyz = np.where(np.isin(FREE.nodes.id, [1, 3, 9])[:, None], 0.2, FREE.nodes.xyz)
    at = Nodes(FREE.nodes.id, xyz, FREE.nodes.frame)
    with pytest.raises(SceneError, match="nodes 1, 3, 9 coincide"):
        tie_nodes(replace(FREE, nodes=at, interfaces=nodes_of(1, 3, 9)), "end", Tie("average"))


@pytest.mark.parametrize(("digits", "factors"), [(5, 1), (10, 0)])
def test_coordinates_of_few_digits_follow_from_the_stiffness_and_those_of_many_need_no_factor(digits, factors):
    """Both leave a tied body free in six motions, with the frequencies of exact coordinates."""
    assert FREE.nodes is not None
    rounding = 10.0**-digits
    xyz = rounding * np.round((FREE.nodes.xyz + np.array([0.12345678912, 0, 0])) / rounding)
    printed = replace(FREE, nodes=replace(FREE.nodes, xyz=xyz, xyz_rounding=rounding))
    with solver_settings(SolverSettings()) as settings:
        placed = places_by_stiffness(printed)
    assert len(settings.work) == factors
    found = []
    for body in (FREE, placed):
        tied = tie_nodes(tie_nodes(body, "end", Tie("rigid")), "start", Tie("rigid"))
        rigid = rigid_body_modes(
            tied.K, tied.M, rigid_body_shapes(tied.dofs, tied.nodes), tied.stiffness_rounding, "bar"
        )
        assert rigid.shape[1] == 6
        found.append(la.eigvalsh(tied.K.toarray(), tied.M.toarray())[6:12])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)


def test_a_point_that_no_mass_turns_with_has_no_inertia_by_round_off():
    """Elements of one integration point: mass moves with the mean of a section alone, as of CalculiX's C3D8R."""
    cells = (3, 1, 1)
    body = block("bar", (0.3, 0.07, 0.013), cells, {"end": face(cells, 3)})
    share = np.array([0.13, 0.21, 0.29, 0.37])
    order = np.argsort(np.concatenate([body.dofs.rows(node, [1, 2, 3]) for i in range(4) for node in face(cells, i)]))
    M = np.kron(np.eye(4), np.kron(np.outer(share, share), np.eye(3)))[np.ix_(order, order)]
    middle = share @ body.nodes.xyz[body.nodes.index(face(cells, 3))]
    tied = tie_nodes(replace(body, M=sp.csc_array(M)), "end", Tie("rigid", position=middle))
    own = point_rows(tied)
    np.testing.assert_allclose(tied.M[own[:3]].toarray()[:, own[:3]], np.eye(3), atol=1e-15)
    assert not tied.M[own[3:]].nnz
