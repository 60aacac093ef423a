"""Proof of the row order, and every cause that its message can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read import MatrixSource, prove_row_order, read_body

Frame = Callable[..., FEModel]
TURNED = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
TILTED = np.array([[np.cos(0.5), np.sin(0.5), 0], [-np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
FRAMES = {25: TURNED, 40: TILTED}


def swapped(dofs: DofTable, a: int, b: int) -> DofTable:
    node = dofs.node.copy()
    node[dofs.node == a], node[dofs.node == b] = b, a
    return DofTable(node, dofs.component)


def exchanged(dofs: DofTable, a: int, b: int) -> np.ndarray:
    """Order of rows with two nodes exchanged."""
    order = np.arange(len(dofs))
    order[dofs.node == a], order[dofs.node == b] = order[dofs.node == b], order[dofs.node == a]
    return order


def with_frame(nodes: Nodes, node: int, frame: np.ndarray) -> Nodes:
    axes = nodes.frame.copy()
    axes[nodes.index(node)[0]] = frame
    return Nodes(nodes.id, nodes.xyz, axes)


def refusal(body: FEModel) -> str:
    with pytest.raises(DofMapError) as caught:
        prove_row_order(body)
    return str(caught.value)


@pytest.mark.parametrize("frames", [{}, FRAMES])
def test_a_body_in_order_is_proven(space_frame: Frame, frames: dict[int, np.ndarray]) -> None:
    proof = prove_row_order(space_frame(frames))
    assert (proof.status, proof.motions) == ("proven", 6)
    assert proof.residual < 1e-14 < proof.tolerance < 1e-12


def test_constraints_leave_the_motions_that_keep_them_at_rest(space_frame: Frame) -> None:
    body = space_frame()
    for held, motions in (([1], 5), ([1, 2, 3], 3), ([3, 4], 4)):
        gone = (body.dofs.node == 10) & np.isin(body.dofs.component, held)
        proof = prove_row_order(part_of(body, gone))
        assert (proof.status, proof.motions) == ("proven", motions)
    # Nodes 3 and 25 lie in one plane with node 10: the motions that it leaves move none of their rows in it.
    proof = prove_row_order(part_of(body, (body.dofs.node == 10) & np.isin(body.dofs.component, [1, 2, 6])))
    assert proof.status == "grounded" and "leave 4 rows (3.1, 3.2, 25.1, 25.2) at rest" in proof.remark
    proof = prove_row_order(part_of(body, body.dofs.node == 10))
    assert (proof.status, proof.motions) == ("grounded", 0)
    assert "constraints hold the body" in proof.remark


def part_of(body: FEModel, gone: np.ndarray) -> FEModel:
    """The body with some dofs held at zero, as an SPC leaves it."""
    kept, dofs = np.flatnonzero(~gone), body.dofs
    table = DofTable(dofs.node[kept], dofs.component[kept])
    held = DofTable(dofs.node[gone], dofs.component[gone])
    K, M = body.K[kept][:, kept], body.M[kept][:, kept]
    return FEModel(body.name, K, M, table, nodes=body.nodes, constrained=held)


def test_what_needs_no_proof(space_frame: Frame) -> None:
    loose = space_frame()
    assert prove_row_order(replace(loose, nodes=None)).status == "no geometry"
    scalar = FEModel("s", sp.csc_array(np.eye(2)), sp.csc_array(np.eye(2)), DofTable([1, 2], [0, 0]))
    assert prove_row_order(scalar).status == "scalar"


def test_static_condensation_keeps_the_proof(space_frame: Frame) -> None:
    body = space_frame(FRAMES)
    K = body.K.toarray()
    i = np.flatnonzero(np.isin(body.dofs.node, [10, 25, 40]))
    j = np.flatnonzero(~np.isin(body.dofs.node, [10, 25, 40]))
    reduced = K[np.ix_(i, i)] - K[np.ix_(i, j)] @ np.linalg.solve(K[np.ix_(j, j)], K[np.ix_(j, i)])
    table = DofTable(body.dofs.node[i], body.dofs.component[i])
    small = FEModel("g", sp.csc_array(reduced), sp.csc_array(np.eye(i.size)), table, nodes=body.nodes)
    assert prove_row_order(small).status == "proven"
    assert "node" in refusal(replace(small, dofs=swapped(table, 10, 40)))


@pytest.mark.parametrize(("rounding", "digits"), [(2.0**-24, 7), (5e-11, 10), (5e-6, 5)])
def test_the_tolerance_follows_the_digits_of_the_file(space_frame: Frame, rounding: float, digits: int) -> None:
    body = space_frame(FRAMES)
    K = body.K.tocoo()
    printed = sp.csc_array((np.array([float(f"{v:.{digits - 1}e}") for v in K.data]), (K.row, K.col)))
    assert prove_row_order(replace(body, K=printed, rounding=rounding)).status == "proven"
    if digits > 5:
        # Where the file does not state its digits, the forces show them.
        proof = prove_row_order(replace(body, K=printed))
        assert rounding / 10 < max(proof.rounding, proof.noise) < 100 * rounding
    else:
        assert "node" in refusal(replace(body, K=printed))


def rounded(K: sp.csc_array, digits: int | None, step: float = 1.0) -> sp.csc_array:
    """Entries with a few digits, or as multiples of a step."""
    data = np.round(K.data / step) * step if digits is None else [float(f"{v:.{digits - 1}e}") for v in K.data]
    return sp.csc_array((data, K.indices, K.indptr), shape=K.shape)


@pytest.mark.parametrize(("digits", "words"), [(4, "4 digits"), (5, "5 digits"), (None, "multiples of 1000")])
def test_rounded_entries_are_named_and_not_mistaken_for_shuffled_rows(
    space_frame: Frame, digits: int | None, words: str
) -> None:
    body = space_frame(FRAMES)
    # The largest entries have seven digits before the point.
    sound = body.K * (3.1e6 / abs(body.K).max())
    coarse = replace(body, K=rounded(sound, digits, 1000.0))
    assert f"Likely cause: the entries of the stiffness are rounded to {words}, " in refusal(coarse)
    shuffled = refusal(replace(coarse, dofs=swapped(body.dofs, 10, 40)))
    assert "rounded" not in shuffled and "40" in shuffled
    # A spring that is no rounding.
    row = body.dofs.rows(25, [1])[0]
    held = coarse.K + sp.csc_array(([2.0e5], ([row], [row])), shape=sound.shape)
    assert "rounded" not in refusal(replace(coarse, K=held))


def test_the_tolerance_follows_the_digits_of_coordinates_and_frames(space_frame: Frame) -> None:
    body = space_frame(FRAMES)
    assert body.nodes is not None
    xyz, frame = body.nodes.xyz.copy(), body.nodes.frame.copy()
    xyz += 4e-7 * np.sin(np.arange(xyz.size)).reshape(xyz.shape)
    frame[body.nodes.index(40)[0]] = TILTED @ np.array([[1, 4e-7, 0], [-4e-7, 1, 0], [0, 0, 1]])
    rough = Nodes(body.nodes.id, xyz, frame, xyz_rounding=5e-7, frame_rounding=5e-7)
    assert prove_row_order(replace(body, nodes=rough)).status == "proven"
    refusal(replace(body, nodes=Nodes(body.nodes.id, xyz, frame)))


def test_two_nodes_exchanged(space_frame: Frame) -> None:
    body = space_frame()
    order = exchanged(body.dofs, 1, 40)
    text = refusal(replace(body, K=body.K[order][:, order]))
    assert "5 of 6 nodes resist" in text
    assert "the rows labelled node 1 are those of node 40" in text
    assert "the rows labelled node 40 are those of node 1" in text


def test_a_spring_to_ground_names_its_node_and_stiffness(space_frame: Frame) -> None:
    body = space_frame()
    row = body.dofs.rows(25, [2])[0]
    spring = sp.csc_array(([0.125], ([row], [row])), shape=body.K.shape)
    text = refusal(replace(body, K=body.K + spring))
    assert "1 of 6 nodes resist" in text
    assert "node 25 is held to the ground" in text
    assert "costs 0.125 units of force" in text
    assert "a body that is meant to be held is `grounded: true`" in text
    assert prove_row_order(replace(body, K=body.K + spring, grounded=True)).status == "proven"


def test_a_spring_between_points_apart_resists_turning_only(space_frame: Frame) -> None:
    body = space_frame()
    rows = np.concatenate([body.dofs.rows(10, [2]), body.dofs.rows(3, [2])])
    k = np.array([[7.0, -7], [-7, 7]])
    spring = sp.csc_array((k.ravel(), (np.repeat(rows, 2), np.tile(rows, 2))), shape=body.K.shape)
    text = refusal(replace(body, K=body.K + spring))
    assert "2 of 6 nodes resist" in text
    assert "join points that do not coincide" in text and "grounded" not in text


def test_matrices_in_basic_though_the_deck_has_frames(space_frame: Frame) -> None:
    body = space_frame()
    turned = space_frame(FRAMES)
    text = refusal(replace(body, nodes=turned.nodes))
    assert "matrices are along the basic axes" in text
    assert "gives 2 nodes a displacement frame (node 25 and others)" in text


def test_nodes_that_lost_their_displacement_frame(space_frame: Frame) -> None:
    """A part that was moved by CP alone: grids without a CD keep the basic axes, unlike those in the matrices."""
    body = space_frame(dict.fromkeys((10, 3, 25, 7, 40, 1), TURNED))
    assert body.nodes is not None
    lost = with_frame(with_frame(body.nodes, 3, np.eye(3)), 40, np.eye(3))
    text = refusal(replace(body, nodes=lost))
    assert "2 of 6 nodes along the basic axes (node 3, 40)" in text
    assert "Write the CD of node 10 on their GRID cards" in text


@pytest.mark.parametrize(
    ("keys", "cause"),
    [
        ("appearance", "in the order of appearance in the geometry file"),
        ("component", "sorted by component (all x, then all y, ...)"),
        ("component, appearance", "sorted by component (all x, then all y, ...)"),
    ],
)
def test_rows_in_another_order(space_frame: Frame, keys: str, cause: str) -> None:
    body = space_frame(FRAMES)
    assert body.nodes is not None
    place = body.nodes.index(body.dofs.node)
    order = {
        "appearance": np.lexsort((body.dofs.component, place)),
        "component": np.lexsort((body.dofs.node, body.dofs.component)),
        "component, appearance": np.lexsort((place, body.dofs.component)),
    }[keys]
    assert cause in refusal(replace(body, K=body.K[order][:, order]))


def test_the_deck_s_order_assumed_where_the_rows_are_sorted(space_frame: Frame) -> None:
    body = space_frame()
    assert body.nodes is not None
    order = np.lexsort((body.dofs.component, body.nodes.index(body.dofs.node)))
    table = DofTable(body.dofs.node[order], body.dofs.component[order])
    assert "in the order of their ids" in refusal(replace(body, dofs=table))


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (1000.0, "geometry were in millimetres and the matrices in metres"),
        (1e-3, "geometry were in metres and the matrices in millimetres"),
        (1 / 0.0254, "geometry were in inches and the matrices in metres"),
        (1 / 12, "geometry were in feet and the matrices in inches"),
    ],
)
def test_coordinates_in_another_unit(space_frame: Frame, factor: float, cause: str) -> None:
    body = space_frame(FRAMES)
    assert body.nodes is not None
    nodes = Nodes(body.nodes.id, body.nodes.xyz * factor, body.nodes.frame)
    assert cause in refusal(replace(body, nodes=nodes))


def test_coordinates_printed_too_coarsely(space_frame: Frame) -> None:
    body = space_frame(FRAMES)
    assert body.nodes is not None
    xyz = body.nodes.xyz + 2e-5 * np.sin(np.arange(18)).reshape(6, 3)
    text = refusal(replace(body, nodes=Nodes(body.nodes.id, xyz, body.nodes.frame)))
    assert "printed with too few digits" in text
    off = float(text.split("coordinates wrong by ")[1].split()[0])
    assert 1e-6 < off < 1e-4


def test_rows_that_nothing_explains(space_frame: Frame) -> None:
    body = space_frame(FRAMES)
    order = np.random.default_rng(3).permutation(body.n)
    text = refusal(replace(body, K=body.K[order][:, order]))
    assert "shuffled or of another set than assumed" in text and "grounded" not in text
    assert "worst are" in text
    assert text.count("e-0") + text.count("e+0") >= 5


@pytest.fixture(scope="module")
def block_a(shared_data: Path) -> FEModel:
    folder = shared_data / "block_a"
    source = folder / "block_a.op4"
    return read_body(
        "block",
        stiffness=MatrixSource(source, "kaa"),
        mass=MatrixSource(source, "maa"),
        geometry=folder / "block_a.bdf",
    )


def test_rotations_before_translations_are_named(space_frame: Frame) -> None:
    """Kratos sorts the dofs of a node of a shell in this way."""
    body = space_frame()
    order = np.lexsort((body.dofs.component, body.dofs.component <= 3, body.dofs.node))
    said = refusal(replace(body, K=body.K[order][:, order]))
    assert "the rotations of each node stand before its translations" in said


def test_a_rotation_that_is_called_z_is_named() -> None:
    """Programs for plane frames have x, y and a rotation at each node, and call the rotation its third dof."""
    xyz = np.array([[0.0, 0, 0], [0, 1, 0], [1, 1.2, 0], [2, 1, 0]])
    K = np.zeros((12, 12))
    for k in range(3):
        x, y = xyz[k + 1, :2] - xyz[k, :2]
        # Elongation and the two rotations against the chord, of EA = 100 and EI = 2 on the length.
        size = np.hypot(x, y)
        chord = np.array([y, -x, 0, -y, x, 0]) / size**2
        along = np.array([-x, -y, 0, x, y, 0]) / size
        B = np.array([along, np.eye(6)[2] - chord, np.eye(6)[5] - chord])
        K[3 * k : 3 * k + 6, 3 * k : 3 * k + 6] += B.T @ [[100, 0, 0], [0, 8, 4], [0, 4, 8]] @ B / size
    parts = {"K": sp.csc_array(K), "M": sp.csc_array(np.eye(12)), "nodes": Nodes.in_basic(np.arange(1, 5), xyz)}
    node = np.repeat(np.arange(1, 5), 3)
    assert prove_row_order(FEModel("frame", dofs=DofTable(node, np.tile([1, 2, 6], 4)), **parts)).status == "proven"
    said = refusal(FEModel("frame", dofs=DofTable(node, np.tile([1, 2, 3], 4)), **parts))
    assert "the third dof of each node is its rotation about z" in said and "such as 12.1, 12.2, 12.6" in said
    # A clamp and a spring leave no motion without force that would prove it.
    held = K + np.diag([1e3] * 3 + [0.0] * 7 + [5.0, 0])
    said = refusal(FEModel("frame", dofs=DofTable(node, np.tile([1, 2, 3], 4)), **{**parts, "K": sp.csc_array(held)}))
    assert "Or the third dof of each node is its rotation about z" in said and "name it 6" in said


@pytest.mark.shared
class TestBlock:
    """A solid of 525 nodes: a fault at one node leaves most of the body in order."""

    def test_is_proven(self, block_a: FEModel) -> None:
        proof = prove_row_order(block_a)
        assert (proof.status, proof.motions) == ("proven", 6)
        assert proof.residual < 1e-14

    @pytest.mark.parametrize(("a", "b"), [(17, 300), (17, 18)])
    def test_two_nodes_exchanged_are_named(self, block_a: FEModel, a: int, b: int) -> None:
        order = exchanged(block_a.dofs, a, b)
        text = refusal(replace(block_a, K=block_a.K[order][:, order]))
        assert f"the rows labelled node {a} are those of node {b}" in text
        assert f"the rows labelled node {b} are those of node {a}" in text
        assert "All other rows are in order" in text

    def test_a_wrong_displacement_frame_is_named_with_its_angle(self, block_a: FEModel) -> None:
        assert block_a.nodes is not None
        text = refusal(replace(block_a, nodes=with_frame(block_a.nodes, 100, TILTED)))
        assert "Without these frames the forces vanish" in text
        # Two frames, one of them right: now dropping both explains nothing.
        rows = block_a.dofs.rows(200, [1, 2, 3])
        turn = sp.eye_array(block_a.n, format="lil")
        turn[np.ix_(rows, rows)] = TURNED
        K = sp.csc_array(turn @ block_a.K @ turn.T)
        right = with_frame(block_a.nodes, 200, TURNED)
        assert prove_row_order(replace(block_a, K=K, nodes=right)).status == "proven"
        text = refusal(replace(block_a, K=K, nodes=with_frame(right, 100, TILTED)))
        assert "the rows of node 100 are along the basic axes, not along its displacement frame" in text
        text = refusal(replace(block_a, K=K))
        assert "the rows of node 200 are along axes turned by 120 degrees from the basic axes" in text

    def test_a_moved_node_is_put_where_it_stands(self, block_a: FEModel) -> None:
        assert block_a.nodes is not None
        xyz = block_a.nodes.xyz.copy()
        true = xyz[block_a.nodes.index(100)[0]].copy()
        xyz[block_a.nodes.index(100)[0]] += [0.01, 0, 0]
        text = refusal(replace(block_a, nodes=Nodes.in_basic(block_a.nodes.id, xyz)))
        place = ", ".join(f"{x:.6g}" for x in true)
        assert f"node 100 is at ({place}) in the matrices" in text

    def test_exchanged_components_are_named(self, block_a: FEModel) -> None:
        order = np.arange(block_a.n)
        x, y = block_a.dofs.rows(100, [1, 2])
        order[[x, y]] = y, x
        text = refusal(replace(block_a, K=block_a.K[order][:, order]))
        assert "the rows of node 100 are left-handed" in text

    def test_a_soft_spring_to_ground_is_found(self, block_a: FEModel) -> None:
        row = int(block_a.dofs.rows(100, [3])[0])
        k = 1e-9 * block_a.K[row, row]
        spring = sp.csc_array(([k], ([row], [row])), shape=block_a.K.shape)
        text = refusal(replace(block_a, K=block_a.K + spring))
        assert "1 of 525 nodes resist" in text
        assert "node 100 is held to the ground" in text

    def test_an_unknown_clamp_is_reported_as_ground(self, block_a: FEModel) -> None:
        body = part_of(block_a, np.isin(block_a.dofs.node, [100, 101, 200]))
        proof = prove_row_order(body)
        # The three nodes have no rows, and their neighbours are next to the ground.
        assert (proof.status, proof.motions) == ("proven", 0) and "of 522 nodes resist" in proof.remark
        text = refusal(replace(body, constrained=None))
        assert "fixed by a support that is not in the geometry file" in text

    def test_all_rows_in_order_of_another_mesh(self, block_a: FEModel) -> None:
        order = np.random.default_rng(1).permutation(525)
        rows = (3 * order[:, None] + np.arange(3)).ravel()
        text = refusal(replace(block_a, K=block_a.K[rows][:, rows]))
        assert "by the motions that cost no force, the rows of " in text and "nodes are in another order" in text
