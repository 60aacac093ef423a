"""Bodies in one piece and in several, and motions without stiffness and mass."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.linalg.eigen import elastic_pairs, only_motions, rigid_body_modes
from cmsreduce.mechanics import check_connected, hold_undetermined
from cmsreduce.mechanics.pieces import parts, rows_alone
from cmsreduce.model import DofTable, FEModel, Interface, Nodes, Recovery, Source, rigid_body_shapes
from tests.frames import BAR, Section, beam_matrices, frame, line, rotation
from tests.plates import isotropic_laminate, plate_body
from tests.solids import block

CHAIN = 34
FIVE = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 0, 0], [6, 0, 0]]


def aircraft(twist: float) -> FEModel:
    """Stick model of an aircraft, 71 nodes, towing a straight chain of bars that turns freely about itself.

    The chain's bars have the torsional stiffness ``twist`` G J but no inertia in torsion, and its first one is not
    connected in torsion: 34 of 426 dofs have no mass, and their own stiffness is singular.
    """
    fuselage = [[x, 0.0, 0.0] for x in np.linspace(0, 3, 13)]
    wing = [[1.2 + 0.3 * abs(y), y, 0.05 * abs(y)] for y in np.linspace(-2, 2, 17) if y]
    tail = [[2.9 + 0.1 * k, side * 0.2 * k, 0.1 * k] for side in (-1, 1) for k in range(1, 5)]
    main = np.array([*fuselage, *wing, *tail])
    assert len(main) == 37
    bars = [(k, k + 1) for k in range(1, 13)]
    bars += [(k, k + 1) for k in range(14, 21)] + [(k, k + 1) for k in range(22, 29)] + [(21, 6), (6, 22)]
    bars += [(13, 30), (13, 34)] + [(k, k + 1) for k in (30, 31, 32, 34, 35, 36)]
    rope = np.array([[3.0 + 0.1 * k, 0, 0] for k in range(1, CHAIN + 1)])
    whole = frame("aircraft", np.vstack([main, rope]), bars, {"root": 6})
    K, M = whole.K.tolil(), whole.M.tolil()
    links = [13, *range(38, 38 + CHAIN)]
    for i, j in pairwise(links):
        section = Section(J=0.0 if i == 13 else twist * BAR.J, A=1e-4)
        k, m = beam_matrices(whole.nodes.xyz[i - 1], whole.nodes.xyz[j - 1], section)
        m[[3, 9]] = m[:, [3, 9]] = 0.0
        rows = np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j]
        K[np.ix_(rows, rows)] += k
        M[np.ix_(rows, rows)] += m
    return replace(whole, K=sp.csc_array(K), M=sp.csc_array(M))


def rigid_of(body: FEModel) -> np.ndarray:
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    return rigid_body_modes(body.K, body.M, R, body.rounding, body.name)


ADVICE = "NASTRAN holds rotations about normals of plates in KAA and not in KGG: give KAA and MAA"


@pytest.mark.parametrize("digits", [None, 10], ids=["double", "ten digits"])
@pytest.mark.parametrize(("twist", "count"), [(1.0, 1), (0.0, CHAIN)], ids=["torsion bar", "no torsion"])
def test_an_aircraft_whose_massless_stiffness_is_singular(twist, count, digits):
    body = aircraft(twist)
    if digits:
        K, M = (sp.csc_array(A) for A in (body.K, body.M))
        for A in (K, M):
            A.data = np.array([float(f"{x:.{digits - 1}e}") for x in A.data])
        body = replace(body, K=K, M=M, rounding=0.5 * 10.0 ** (1 - digits))
    o = np.flatnonzero(body.M.diagonal() == 0)
    assert (body.n, o.size) == (426, 34)
    # Condensation of the massless dofs cannot be done: they have a motion of their own.
    assert np.linalg.matrix_rank(body.K[o][:, o].toarray(), rtol=1e-8) == CHAIN - count
    found = hold_undetermined(body)
    held = found.body
    assert held.n == 426 - count and len(held.constrained) == count == len(found.held)
    assert set(found.held) <= {body.dofs.labels[row] for row in o}
    assert found.note.startswith(f"aircraft: neither stiffness nor mass determines {count} motions; held: ")
    assert found.lost == ()
    assert "KAA" not in found.note
    of_plates = replace(found, body=replace(held, sources=(Source("a.op4", "", "stiffness KGG"),)))
    assert of_plates.note == f"{found.note}. {ADVICE}"
    # The chain's torsion moves nothing else, so that taking all of it out changes no frequency.
    keep = np.setdiff1d(np.arange(body.n), o)
    lam = la.eigh(body.K[keep][:, keep].toarray(), body.M[keep][:, keep].toarray(), eigvals_only=True)
    rigid = rigid_of(held)
    assert rigid.shape[1] == 6
    found_lam, _ = elastic_pairs(held.K.toarray(), held.M.toarray(), rigid, held.rounding)
    assert found_lam.size == 426 - 34 - 6
    np.testing.assert_allclose(found_lam[:40], lam[6:46], rtol=1e-8 if digits is None else 1e-4)


def straight(**options) -> FEModel:
    """A boom along x without inertia about itself, as with lumped masses."""
    body = line("boom", [0, 0, 0], [2, 0, 0], 5, **options)
    spin = body.dofs.component == 4
    M = body.M.toarray()
    M[np.ix_(spin, spin)] = 0.0
    return replace(body, M=sp.csc_array(M))


def test_a_boom_that_spins_without_inertia_carries_no_torque():
    """One dof is held, and neither end keeps its torsion: else the joint there would be held to the ground."""
    found = hold_undetermined(straight())
    assert len(found.held) == 1 and found.held[0].endswith(".4")
    assert found.lost == (("a", ("1.4",)), ("b", ("6.4",)))
    assert found.body.interfaces["a"].components == found.body.interfaces["b"].components == ((1, 2, 3, 5, 6),)
    assert "interface 'b' loses 6.4" in found.note
    assert rigid_of(found.body).shape[1] == 5
    # All that remains at the interfaces: they hold the five rigid motions and no more of the ground than that.
    i = found.body.interface_rows("a")
    j = np.setdiff1d(np.arange(found.body.n), i)
    K = found.body.K.toarray()
    boundary = K[np.ix_(i, i)] - K[np.ix_(i, j)] @ np.linalg.solve(K[np.ix_(j, j)], K[np.ix_(j, i)])
    assert abs(boundary).max() < 1e-9 * abs(K).max()


def test_a_dof_named_by_the_user_is_not_taken():
    with pytest.raises(SceneError, match=r"'boom', interface 'a': its `dofs:` name 1\.4, which move without stiffness"):
        hold_undetermined(straight(), named=["a"])
    free = straight(interfaces={"a": (1, (1, 2, 3, 5, 6))})
    assert hold_undetermined(free, named=["a"]).lost == ()
    with pytest.raises(SceneError, match=r"interface 'a': no other dof is left of a node at 1\.4"):
        hold_undetermined(straight(interfaces={"a": (1, (4,))}))


def test_a_body_without_mass_is_refused():
    body = straight()
    with pytest.raises(MatrixError, match="body 'boom' has no mass"):
        hold_undetermined(replace(body, M=sp.csc_array(body.M.shape)))


def test_nothing_is_held_in_a_sound_body():
    """Whole bodies, held ones, mechanisms with mass, and dofs without mass that stiffness holds."""
    bent = frame("bent", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2]], [(1, 2), (2, 3), (3, 4)])
    spin = bent.dofs.component > 3
    lumped = replace(bent, M=sp.csc_array(np.diag(np.where(spin, 0.0, bent.M.diagonal()))))
    point = FEModel("point", sp.csc_array((6, 6)), sp.eye_array(6, format="csc"), DofTable([1] * 6, range(1, 7)))
    held = straight(held=[1])
    for body in (bent, lumped, point, held, replace(bent, rounding=6e-8)):
        found = hold_undetermined(body)
        assert (found.held, found.note) == ((), "")
        assert found.body is body


def test_a_rotation_about_a_skew_axis_is_one_motion():
    """A ball on a spoke: nothing resists its rotation about the spoke, for any axes of its node."""
    axes = np.array([np.eye(3), rotation([1, 2, 3], 0.8)])
    body = frame("spoke", [[0, 0, 0], [0.6, 0.8, 0]], [(1, 2)], axes=axes, section=Section(J=0.0))
    along = np.array([0.6, 0.8, 0])
    M = body.M.toarray()
    M[6:, 6:] += np.diag([1.0, 1, 1, 0, 0, 0])
    # The bar's own inertia about itself is taken out.
    for k in (0, 1):
        a = axes[k] @ along
        rows = slice(6 * k + 3, 6 * k + 6)
        P = np.eye(12)
        P[rows, rows] -= np.outer(a, a)
        M = P @ M @ P
    body = replace(body, M=sp.csc_array((M + M.T) / 2))
    found = hold_undetermined(body)
    assert len(found.held) == 2
    assert {label.split(".")[0] for label in found.held} == {"1", "2"}
    # K and M vanish on both motions, so that any complement has the same frequencies.
    N = np.zeros((12, 2))
    for k in (0, 1):
        N[6 * k + 3 : 6 * k + 6, k] = axes[k] @ along
    Q = la.null_space(N.T)
    expected = la.eigh(Q.T @ body.K @ Q, Q.T @ body.M @ Q, eigvals_only=True)
    kept = la.eigh(found.body.K.toarray(), found.body.M.toarray(), eigvals_only=True)
    np.testing.assert_allclose(kept[5:], expected[5:], rtol=1e-9)
    assert rigid_of(found.body).shape[1] == 5


def test_what_depends_on_rows_follows():
    """Damping, sets, tied dofs and constraints of the source, through a row that is taken out."""
    body = straight(interfaces={})
    dofs = DofTable(np.append(body.dofs.node, 99), np.append(body.dofs.component, 2))
    extra = FEModel(
        "boom",
        sp.csc_array(sp.block_diag([body.K, sp.csc_array((1, 1))])),
        sp.csc_array(sp.block_diag([body.M, sp.csc_array((1, 1))])),
        dofs,
        Nodes.in_basic([*range(1, 7), 99], np.vstack([body.nodes.xyz, [[0, 0, 9]]])),
        D=sp.csc_array(sp.block_diag([0.1 * body.K, sp.csc_array((1, 1))])),
        sets={"b": np.array([0, 36, 35])},
        constrained=DofTable([99], [1]),
        tied=Recovery(DofTable([77, 77], [1, 2]), dofs, sp.csr_array(([2.0, 3.0], ([0, 1], [36, 35])), shape=(2, 37))),
    )
    found = hold_undetermined(extra).body
    assert found.n == 35
    assert found.constrained.labels[:1] == ["99.1"] and "99.2" in found.constrained.labels
    assert [found.dofs.labels[row] for row in found.sets["b"]] == ["1.1", "6.6"]
    np.testing.assert_array_equal(found.tied.T.toarray().sum(axis=1), [0, 3])
    np.testing.assert_allclose(found.D.toarray(), 0.1 * found.K.toarray(), rtol=1e-12)


def test_a_damper_counts_as_a_hold():
    body = straight(interfaces={})
    damper = np.zeros(36)
    damper[3] = 5.0
    assert hold_undetermined(replace(body, D=sp.csc_array(np.diag(damper)))).held == ()


def test_what_acts_or_measures_along_such_a_motion_is_refused():
    found = hold_undetermined(straight())
    labels = found.body.dofs.labels
    spinning = [k for k, label in enumerate(labels) if label.endswith(".4")]
    assert len(spinning) == 5
    rows = np.zeros((3, found.body.n))
    rows[0, spinning[1]] = 1.0
    # A bending moment and the twist between two sections are what they are.
    rows[1, labels.index("3.5")] = 1.0
    rows[2, spinning[:2]] = 1.0, -1.0
    found.check_untouched(sp.csr_array(rows[1:]), "what acts")
    found.check_untouched(sp.csr_array((0, found.body.n)), "what acts")
    with pytest.raises(SceneError, match=rf"'boom': what acts at {labels[spinning[1]]} moves with {found.held[0]} in"):
        found.check_untouched(sp.csr_array(rows), "what acts")


@pytest.mark.parametrize("elements", [20, 140], ids=["dense", "sparse"])
def test_many_motions_in_bodies_of_any_size(elements):
    """Bars side by side, joined at one end, that all turn about themselves: 18 motions beside the rigid ones."""
    count = 18
    section = Section(J=1e-8)
    hub = np.array([[0.0, 0.05 * k, 0.0] for k in range(count)])
    per = max(elements // count, 2)
    xyz, bars = [*hub], [(k, k + 1) for k in range(1, count)]
    free_bars = []
    for k in range(count):
        last = k + 1
        for step in range(1, per + 1):
            xyz.append(hub[k] + [0.1 * step, 0, 0])
            free_bars.append((last, len(xyz), step == 1))
            last = len(xyz)
    body = frame("comb", xyz, bars)
    K, M = body.K.tolil(), body.M.tolil()
    for i, j, first in free_bars:
        k, m = beam_matrices(body.nodes.xyz[i - 1], body.nodes.xyz[j - 1], Section(J=0.0) if first else section)
        m[[3, 9]] = m[:, [3, 9]] = 0.0
        rows = np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j]
        K[np.ix_(rows, rows)] += k
        M[np.ix_(rows, rows)] += m
    body = replace(body, K=sp.csc_array(K), M=sp.csc_array(M), interfaces={"root": face_of(body)})
    assert (body.n > 600) == (elements > 100)
    found = hold_undetermined(body)
    assert len(found.held) == count and found.lost == ()
    assert len({body.dofs.node[body.dofs.labels.index(label)] % 10**6 for label in found.held}) == count
    assert rigid_of(found.body).shape[1] == 6


def face_of(body: FEModel) -> Interface:
    return Interface("root", np.array([1]), ((1, 2, 3, 4, 5, 6),), body.nodes.xyz[:1], np.eye(3))


def test_one_piece():
    body = frame("bar", FIVE, [(1, 2), (2, 3), (3, 4), (4, 5)])
    assert set(parts(body)) == {0}
    check_connected(body)


def test_pieces_are_named():
    body = frame("bars", FIVE, [(1, 2), (2, 3), (4, 5)])
    assert np.unique(parts(body), return_counts=True)[1].tolist() == [18, 12]
    with pytest.raises(
        MatrixError, match=r"'bars' is not one piece: 2 parts .*3 nodes around node 1; 2 nodes around node 4"
    ):
        check_connected(body)


def test_thousands_of_pieces_are_named_as_fast_as_few():
    """Unmerged nodes: all rows were looked at for each piece, and five of these are named."""
    cost = []
    for count in (40, 30000):
        nodes = 60000 // count
        ids, last = np.arange(1, 60001), np.arange(60000) % nodes == nodes - 1
        off = -np.ones(59999)
        off[last[:-1]] = 0
        K = sp.csc_array(sp.diags_array([np.full(60000, 2.0), off, off], offsets=[0, 1, -1]))
        table = DofTable(ids, np.ones(ids.size, dtype=int))
        body = FEModel("mesh", K, sp.eye_array(ids.size, format="csc"), table)
        start = time.process_time()
        with pytest.raises(MatrixError, match=rf"{count} parts share .* around node {4 * nodes + 1} \.\.\."):
            check_connected(body)
        cost.append(time.process_time() - start)
    assert cost[1] < 5 * cost[0] + 0.2


STAR = [[0, 0, 0], *([s * k, c * k, 0.1 * k] for s, c in ((1, 0), (0, 1), (-1, -1)) for k in (1, 2, 3, 4))]
ARMS = [(1, 2), (1, 6), (1, 10), *((k, k + 1) for k in range(2, 13) if k not in (5, 9))]


def test_arms_that_meet_at_a_held_node_are_a_sound_body():
    """A clamped aircraft without the rows of its clamp was refused: its wings share nothing."""
    body = frame("star", STAR, ARMS, held=[1])
    assert np.unique(parts(body), return_counts=True)[1].tolist() == [24, 24, 24]
    note = check_connected(body)
    assert note.startswith("star: the ground holds 3 parts of it one by one") and "4 nodes around node 6" in note
    assert rigid_of(body).shape[1] == 0
    # Rounded to ten digits, and with an arm that ends before the clamp.
    K = sp.csc_array(([float(f"{x:.9e}") for x in body.K.data], body.K.indices, body.K.indptr), shape=body.K.shape)
    assert check_connected(replace(body, K=K, rounding=5e-11)) == note
    loose = frame("star", STAR, [bar for bar in ARMS if bar != (1, 6)], held=[1])
    with pytest.raises(MatrixError, match=r"3 parts .*; the ground does not hold 1 of them \(4 nodes around node 6\)"):
        check_connected(loose)
    with pytest.raises(MatrixError, match=r"3 parts share neither stiffness nor mass \(4 nodes"):
        check_connected(replace(body, nodes=None))


@pytest.mark.parametrize("components", [range(6), [0]], ids=["whole node", "one component"])
def test_rows_that_keep_their_own_diagonal_are_named(components):
    """A program that takes a support out of the equations may leave its stiffness and mass on the diagonal."""
    body = frame("bar", FIVE, [(1, 2), (2, 3), (3, 4), (4, 5)])
    K, M = body.K.toarray(), body.M.toarray() + 0.1 * np.eye(body.n)
    for row in components:
        for A in (K, M):
            own = A[row, row]
            A[row], A[:, row], A[row, row] = 0.0, 0.0, own
    kept = replace(body, K=sp.csc_array(K), M=sp.csc_array(M))
    rows, words = rows_alone(kept)
    assert rows.tolist() == list(components)
    assert words.startswith(f"{len(rows)} rows have a stiffness and a mass of their own")
    if len(rows) == 6:
        with pytest.raises(MatrixError, match=r"'bar' is not one piece: 6 rows .*\(1\.1, 1\.2.*DIAG_ONE"):
            check_connected(kept)


def test_mass_couples_too():
    body = frame("bars", FIVE, [(1, 2), (2, 3), (4, 5)])
    M = body.M.tolil()
    M[12, 18] = M[18, 12] = 1e-3
    check_connected(replace(body, M=sp.csc_array(M)))


def test_an_empty_dof_is_named():
    body = frame("bar", FIVE[:3], [(1, 2), (2, 3)])
    K, M = body.K.tolil(), body.M.tolil()
    for A in (K, M):
        A[9, :] = A[:, 9] = 0.0
    with pytest.raises(MatrixError, match=r"1 dofs have neither stiffness nor mass, the first is 2\.4"):
        check_connected(replace(body, K=sp.csc_array(K), M=sp.csc_array(M)))


@pytest.mark.parametrize("bars", [[(1, 2), (2, 3), (3, 4), (4, 5)], [(1, 2), (2, 3), (4, 5)]])
def test_six_rigid_motions_prove_one_piece(bars):
    """The proof that K resists all others and the graph of its entries agree: of two pieces, K leaves twelve."""
    body = frame("bent", np.array(FIVE) + [[0, 0.1 * k * k, 0] for k in range(5)], bars, {})
    proven = only_motions(body.K, rigid_body_shapes(body.dofs, body.nodes), body.stiffness_rounding)
    assert (proven is None) == (parts(body).max() > 0)
    if proven is not None:
        assert proven.shape[1] == 6
        check_connected(body, proven)
    else:
        with pytest.raises(MatrixError, match="not one piece: 2 parts"):
            check_connected(body, proven)


@pytest.mark.parametrize("arm", [(0.1, 0.0, 0.05), (-0.3, 0.02, 0.1)])
def test_a_massless_arm_that_turns_about_a_line_of_nodes_leaves_rigid_motions_and_mass_as_they_are(arm):
    """An edge follows a point beside it, which turns freely about the edge (*RIGID BODY of CalculiX)."""
    made = block("bar", (1.0, 0.2, 0.1), (4, 2, 1))
    edge = np.flatnonzero((made.nodes.xyz[:, 0] == 1.0) & (made.nodes.xyz[:, 2] == 0.0)) + 1
    on_edge = led_by_a_point(made, edge, np.zeros(3))
    beside = led_by_a_point(made, edge, np.array(arm))
    found = hold_undetermined(beside)
    assert len(found.held) == 1 and found.held[0] in {f"99.{c}" for c in (4, 5, 6)}
    assert hold_undetermined(on_edge).held == ("99.5",)
    lam = []
    for body in (found.body, hold_undetermined(on_edge).body):
        R = rigid_body_shapes(body.dofs, body.nodes)
        assert abs(body.K @ R).max() <= 1e-12 * abs(body.K).max()
        whole = rigid_body_shapes(made.dofs, made.nodes)
        np.testing.assert_allclose(R.T @ body.M @ R, whole.T @ made.M @ whole, rtol=1e-12, atol=1e-12)
        lam.append(elastic_pairs(body.K.toarray(), body.M.toarray(), rigid_of(body), body.rounding)[0])
    np.testing.assert_allclose(lam[0][:20], lam[1][:20], rtol=1e-9)


def led_by_a_point(made: FEModel, led: np.ndarray, arm: np.ndarray) -> FEModel:
    """A body of solids some nodes of which follow node 99, beside the first of them, as one rigid piece."""
    place = made.nodes.xyz[led[0] - 1] + arm
    six = DofTable(np.full(6, 99), np.arange(1, 7, dtype=np.int8))
    other = ~np.isin(made.dofs.node, led)
    T = sp.csc_array(sp.block_diag([sp.eye_array(made.n, format="csc")[:, other], np.zeros((0, 6))], format="csc"))
    T = T.tolil()
    T[~other, -6:] = rigid_body_shapes(made.dofs[~other], made.nodes, place)
    T = sp.csc_array(T)
    nodes = Nodes.in_basic([*made.nodes.id.tolist(), 99], np.vstack([made.nodes.xyz, place]))
    return FEModel(
        "bar", sp.csc_array(T.T @ made.K @ T), sp.csc_array(T.T @ made.M @ T), made.dofs[other].joined(six), nodes, {}
    )


def plate(turn: np.ndarray, cells: int) -> FEModel:
    """A square plate without mass against rotation; nothing resists rotation about its normal."""
    x = np.array([[i, j, 0.0] for i in range(cells + 1) for j in range(cells + 1)]) / cells @ turn.T
    at = [[(cells + 1) * i + j + 1 + k for k in (0, cells + 1, cells + 2, 1)] for i, j in np.ndindex(cells, cells)]
    made = plate_body("plate", x, at, lambda _: isotropic_laminate(7e10, 0.3, 0.01), drilling=0.0)
    M = np.where(made.dofs.component > 3, 0.0, made.M.diagonal())
    return replace(made, M=sp.csc_array(sp.diags_array(M)))


def test_each_node_of_a_skew_plate_turns_freely():
    """The frequencies are those of a plate along the axes without its rotations about z."""
    turn = rotation([1, 2, 3], 0.8)
    found = hold_undetermined(plate(turn, 12))
    assert len(found.held) == found.motions.shape[1] == 169
    assert found.body.n == 5 * 169 and rigid_of(found.body).shape[1] == 6
    flat = plate(np.eye(3), 12)
    rows = np.flatnonzero(flat.dofs.component != 6)
    flat = replace(flat, K=flat.K[rows][:, rows], M=flat.M[rows][:, rows], dofs=flat.dofs[rows])
    np.testing.assert_allclose(elastic_modes(found.body), elastic_modes(flat), rtol=1e-8)


def elastic_modes(body: FEModel) -> np.ndarray:
    """The lowest twelve eigenvalues, of a body without mass against rotation."""
    turns = body.dofs.component > 3
    K = body.K.tocsr()
    inner = la.lu_factor(K[turns][:, turns].toarray())
    across = K[turns][:, ~turns].toarray()
    condensed = K[~turns][:, ~turns].toarray() - across.T @ la.lu_solve(inner, across)
    m = body.M.diagonal()[~turns]
    lam = la.eigvalsh(condensed / np.sqrt(m[:, None] * m), subset_by_index=[0, 17])
    return lam[6:]


def test_a_load_about_the_normal_of_a_skew_plate_is_refused():
    found = hold_undetermined(plate(rotation([1, 2, 3], 0.8), 2))
    rows = sp.csr_array((np.ones(2), ([0, 1], [0, found.body.dofs.rows(5, 4)[0]])), shape=(2, found.body.n))
    found.check_untouched(rows[[0]], "actuator 'push'")
    with pytest.raises(SceneError, match=r"actuator 'push' at 5\.4 moves with"):
        found.check_untouched(rows, "actuator 'push'")
