"""`cmsreduce new` knows bodies by their content: the names of these files say nothing."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner

import cmsreduce as cms
from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import DofMapError, MatrixError, ReadError
from cmsreduce.model import DofTable, FEModel, Nodes, Units, in_units
from cmsreduce.pipeline.bodies.plausible_units import Material, material_of, plausible_units
from cmsreduce.pipeline.drafts import draft_body, draft_pipeline
from cmsreduce.pipeline.drafts.first_mode import softly_tied
from cmsreduce.pipeline.drafts.matrix_roles import matrices_of, stiffness_and_mass
from cmsreduce.pipeline.drafts.proposed_interfaces import Place, proposed_interfaces
from tests.pipeline.study import arm, panel, system_frequencies, write_body
from tests.solids import block, face

E, NU, RHO = 70e9, 0.3, 2700.0
LAME, G = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
AROUND, RADIUS, HALF, THICK = 12, 0.02, 0.05, 0.01


def hexahedron(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of a trilinear brick with any corners (24, 24)."""
    C = np.diag([2 * G] * 3 + [G] * 3)
    C[:3, :3] += LAME
    sign = 2 * CORNERS - 1
    K, M = np.zeros((24, 24)), np.zeros((24, 24))
    for point in product(*[(-1 / np.sqrt(3), 1 / np.sqrt(3))] * 3):
        terms = (1 + sign * point) / 2
        N = terms.prod(axis=1)
        dN = np.array([sign[:, a] / 2 * np.delete(terms, a, axis=1).prod(axis=1) for a in range(3)])
        J = dN @ x
        dN, volume = np.linalg.solve(J, dN), np.linalg.det(J)
        B = np.zeros((6, 24))
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            B[a, a::3] = dN[a]
            B[3 + a, b::3], B[3 + a, c::3] = dN[c], dN[b]
        H = np.kron(N, np.eye(3))
        K += B.T @ C @ B * volume
        M += RHO * H.T @ H * volume
    return K, M


def bracket() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Square plate with a round hole: coordinates, bricks, stiffness and mass in SI."""
    turn = 2 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    square = circle / abs(circle).max(axis=1, keepdims=True)
    rings = [(1 - t) * RADIUS * circle + t * HALF * square for t in (0.0, 0.5, 1.0)]
    xyz = np.array([[*point, z] for z in (0.0, THICK) for ring in rings for point in ring])
    at = np.arange(len(xyz)).reshape(2, 3, AROUND)
    cells = np.array(
        [
            [at[k, r + a, (j + b) % AROUND] for k in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            for r in (0, 1)
            for j in range(AROUND)
        ]
    )
    K, M = np.zeros((2, 3 * len(xyz), 3 * len(xyz)))
    for cell in cells:
        rows = (3 * cell[:, None] + np.arange(3)).ravel()
        k, m = hexahedron(xyz[cell])
        K[np.ix_(rows, rows)] += k
        M[np.ix_(rows, rows)] += m
    return xyz, cells, K, M


def deck(path: Path, xyz: np.ndarray, cells: np.ndarray) -> None:
    cards = ["BEGIN BULK"]
    for node, (x, y, z) in enumerate(xyz, 1):
        cards += [f"GRID*   {node:16d}{'':16}{x:16.9E}{y:16.9E}", f"*       {z:16.9E}"]
    for number, cell in enumerate(cells + 1, 1):
        cards += ["CHEXA,{},1,{},{},{},{},{},{}".format(number, *cell[:6]), ",{},{}".format(*cell[6:])]
    path.write_text("\n".join([*cards, "GRDSET,,,,,,,456", "ENDDATA", ""]))


@pytest.fixture(scope="module")
def plate() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return bracket()


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plate: tuple[np.ndarray, ...]) -> list[Path]:
    """Mass, deck and stiffness of the plate, under names in no order."""
    monkeypatch.chdir(tmp_path)
    xyz, cells, K, M = plate
    for name, A in (("1", M), ("3", K)):
        with Path(name).open("wb") as file:
            scipy.io.mmwrite(file, sp.coo_array(A), symmetry="symmetric", precision=17)
    deck(Path("2"), xyz, cells)
    return [Path("1"), Path("2"), Path("3")]


def typed(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert isinstance(done.exception, SystemExit | None), done.exception
    return done.exit_code, done.output


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_stiffness_mass_and_hole_are_found(files: list[Path], plate: tuple[np.ndarray, ...], order: tuple[int]) -> None:
    draft = draft_body("plate", [files[k] for k in order])
    assert (draft.stiffness[0], draft.mass[0], draft.geometry) == (Path("3"), Path("1"), Path("2"))
    assert (draft.remark, draft.notes, draft.units, draft.units_remark) == ("", (), "", "")
    xyz, _, K, M = plate
    hz = np.sqrt(la.eigvalsh(K, M, subset_by_index=[6, 6])[0]) / (2 * np.pi)
    assert draft.elastic_hz == pytest.approx(hz, rel=1e-6)
    hole = np.flatnonzero(np.hypot(xyz[:, 0], xyz[:, 1]) < 1.01 * RADIUS) + 1
    assert draft.interfaces[0][1] == f"{{nodes: [{', '.join(map(str, hole))}], tie: rigid}}"
    assert draft.interfaces[0][2] == "hole of radius 0.02, at [0, 0, 0.005]"
    names = [name for name, _, _ in draft.proposed]
    assert names == ["face_1", "face_2", "face_3", "face_4", "face_5"]
    sides = [words for _, _, words in draft.proposed[:4]]
    assert all(words.startswith("flat face of area 0.001, at") for words in sides)


def test_from_files_to_a_checked_component(files: list[Path]) -> None:
    code, said = typed("new", "plate", *files)
    assert (code, said) == (0, "plate.yaml written; look at the lines marked CHECK, then: cmsreduce run plate.yaml\n")
    assert typed("run", "plate.yaml", "--quiet") == (0, "")


@pytest.mark.parametrize(
    ("length", "mass", "units"),
    [(1e3, 1e-3, "mm-t-s"), (1 / 0.0254, 1 / 175.126835, "in-slinch-s"), (1e3, 1.0, "mm-kg-s")],
)
def test_units_follow_from_density_and_wave_speed(
    files: list[Path], plate: tuple[np.ndarray, ...], length: float, mass: float, units: str
) -> None:
    xyz, cells, K, M = plate
    np.savez("4", x=mass * K, y=mass * M)
    deck(Path("5"), length * xyz, cells)
    draft = draft_body("plate", [Path("4.npz"), Path("5")])
    assert (draft.stiffness[1], draft.mass[1], draft.units) == ("x", "y", units)
    # sqrt((lambda + 2 mu) / rho) by theory.
    assert f"2.7e+03 kg/m^3 and waves of {np.sqrt((LAME + 2 * G) / RHO):.3g} m/s" in draft.units_remark
    assert draft.elastic_hz == pytest.approx(draft_body("plate", files).elastic_hz, rel=1e-6)
    (said,) = draft_pipeline("plate", [Path("4.npz"), Path("5")]).warnings
    assert said.startswith("units of 'plate': in m-kg-s no material has")


def test_units_that_do_not_belong_together_are_said(files: list[Path], plate: tuple[np.ndarray, ...]) -> None:
    """Stiffness in N/m, mass in grams divided by 9.81, coordinates in metres."""
    np.savez("4", x=plate[2], y=1e-6 * plate[3])
    draft = draft_body("plate", [Path("4.npz"), Path("2")])
    assert draft.units == "" and "units that do not belong together" in draft.units_remark


def test_units_of_a_held_body_follow_from_its_density() -> None:
    """In mm and t, with springs to the ground at four nodes, which no stretch leaves alone."""
    body = in_units(block("brick", [0.3, 0.2, 0.1], [1, 1, 1]), Units.parse("mm-t-s"))
    ground = np.where(body.dofs.node <= 4, 1e7, 0.0)
    held = replace(body, K=sp.csc_array(body.K + sp.diags_array(ground)))
    hexahedra = {"hexahedron": np.array([[1, 5, 7, 3, 2, 6, 8, 4]])}
    found, free = material_of(held, hexahedra), material_of(body, hexahedra)
    assert found is not None and free is not None and free.speed > 0 == found.speed
    units, reason = plausible_units(found)
    assert units == Units.parse("mm-t-s") and "waves" not in reason
    assert material_of(held, {}) is None


def test_rigid_bodies_in_a_mesh_may_seem_to_carry_fast_waves() -> None:
    assert plausible_units(Material(1.0, 2.9e7))[0] == Units.parse("mm-t-s")
    assert plausible_units(Material(1.0, 2.9e9))[0] is None


def test_exchanged_matrices_are_said(files: list[Path], plate: tuple[np.ndarray, ...]) -> None:
    np.savez("4", K=plate[3], M=plate[2])
    code, said = typed("new", "plate", "4.npz", "2")
    assert code == 0
    assert "warning: the names are exchanged: M in 4.npz is the stiffness, since a translation costs no force" in said
    keys = load_pipeline(Path("plate.yaml")).components["plate"]
    assert (keys.stiffness.matrix, keys.mass.matrix) == ("M", "K")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["3", "3", "2"], r"no mass among the matrices found: 3\. .*: cmsreduce new plate STIFFNESS MASS DECK$"),
        (["1", "2"], r"no stiffness among the matrices found: 1\..*: cmsreduce new plate STIFFNESS MASS DECK$"),
        (["twice.npz", "2"], r"a in twice\.npz has the same numbers as b in twice\.npz"),
        (["opaque.npz", "2"], r"no stiffness .*\(left out: opaque\.npz: 'K' holds pickled Python objects"),
        (["empty.npz", "2"], r"no mass .*\(left out: empty\.npz: matrix 'M' is empty\)"),
        (
            ["2"],
            r"files given: 2 \(NASTRAN bulk data\); .*: cmsreduce new plate .* \(PARAM,EXTOUT,DMIGPCH or EXTSEOUT\)",
        ),
        (["3", "1", "2", "picture"], r"picture: this is a picture, which holds no matrix and no nodes"),
        (["gone", "2"], r"gone: there is no such file"),
        (["."], "this is a folder; name the files of the body"),
    ],
)
def test_refusals_end_with_the_next_step(
    files: list[Path], plate: tuple[np.ndarray, ...], given: list[str], message: str
) -> None:
    np.savez("twice", a=plate[2], b=plate[2])
    np.savez("opaque", K=plate[2].astype(object), M=plate[3])
    np.savez("empty", K=plate[2], M=np.zeros((0, 0)))
    Path("picture").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ReadError, match=message):
        draft_body("plate", [Path(name) for name in given])
    assert typed("new", "plate", *given)[0] == 2
    assert not Path("plate.yaml").exists()


def test_stiffness_and_mass_of_quadratic_triangles_in_a_plane(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two dofs a node, and a mass in which the rows of all corners add up to zero."""
    monkeypatch.chdir(tmp_path)
    one = np.array([[6, -1, -1, 0, -4, 0], [-1, 6, -1, 0, 0, -4], [-1, -1, 6, -4, 0, 0], [0, 0, -4, 32, 16, 16]])
    one = np.vstack([one, [[-4, 0, 0, 16, 32, 16], [0, -4, 0, 16, 16, 32]]])
    K, M = np.zeros((9, 9)), np.zeros((9, 9))
    for nodes in ([0, 1, 2, 4, 5, 6], [1, 3, 2, 7, 8, 5]):
        K[np.ix_(nodes, nodes)] += 6 * np.eye(6) - 1
        M[np.ix_(nodes, nodes)] += one / 180
    np.savez("a", np.kron(K, np.eye(2)))
    np.savez("b", np.kron(M, np.eye(2)))
    every = [one for name in ("a.npz", "b.npz") for one in matrices_of(Path(name), None, ())[0]]
    for order in (every, every[::-1]):
        found = stiffness_and_mass("plane", order, None, (), "")
        assert [source[0].stem for source in (found.stiffness, found.mass)] == ["a", "b"]


def test_dashpots_are_no_mass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some to the ground, and two between nodes: translations are resisted in most of their rows."""
    monkeypatch.chdir(tmp_path)
    K = np.kron(np.diag([1.0, *[2.0] * 10, 1.0]) - np.eye(12, k=1) - np.eye(12, k=-1), np.eye(2))
    D = np.diag([5.0] * 6 + [0.0] * 18)
    D[np.ix_([10, 14], [10, 14])] += [[3.0, -3.0], [-3.0, 3.0]]
    np.savez("a", K)
    np.savez("b", D)
    every = [one for name in ("a.npz", "b.npz") for one in matrices_of(Path(name), None, ())[0]]
    with pytest.raises(ReadError, match="no matrix is clearly the mass"):
        stiffness_and_mass("row", every, None, (), "")


def test_a_damping_that_is_left_out_is_said(files: list[Path], plate: tuple[np.ndarray, ...]) -> None:
    np.savez("4", K=plate[2], M=plate[3], D=1j * plate[2])
    code, said = typed("new", "plate", "4.npz", "2")
    assert code == 0 and "warning: left out: 4.npz: matrix 'D' is complex" in said


def test_a_body_without_stiffness_has_the_usual_band(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One rigid node; its draft can be run, and says that nothing elastic is there to be measured."""
    monkeypatch.chdir(tmp_path)
    np.savez("node.npz", K=np.zeros((6, 6)), M=np.diag([2.0, 2, 2, 0.1, 0.2, 0.3]))
    Path("node.bdf").write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nENDDATA\n")
    assert typed("new", "node", "node.npz", "node.bdf")[0] == 0
    assert "  band: 10 Hz" in Path("node.yaml").read_text()
    code, said = typed("run", "node.yaml")
    assert code == 1 and "no channel has an elastic response" in said


def test_a_file_given_twice_is_left_out(files: list[Path]) -> None:
    Path("copy").write_bytes(Path("3").read_bytes())
    draft = draft_body("plate", [*files, Path("copy")])
    assert draft.notes == ("copy has the same content as 3, and is left out",)


def test_a_punch_file_between_the_marks_of_a_deck_is_no_deck(tmp_path: Path) -> None:
    body = panel()
    write_body(tmp_path, body)
    cards = ["BEGIN BULK"]
    for name, A in (("KAAX", body.K), ("MAAX", body.M)):
        cards.append(f"DMIG    {name}           0       6       2       0")
        lower = sp.tril(A).tocsc()
        for column in range(body.n):
            start, end = lower.indptr[column : column + 2]
            cards.append(f"DMIG*   {name}            {body.dofs.node[column]:16d}{body.dofs.component[column]:16d}")
            for row, value in zip(lower.indices[start:end], lower.data[start:end], strict=True):
                cards.append(f"*       {body.dofs.node[row]:16d}{body.dofs.component[row]:16d}{value:16.9E}")
    punch, deck = tmp_path / "body.pch", tmp_path / f"{body.name}.bdf"
    punch.write_text("\n".join([*cards, "ENDDATA", ""]))
    found = draft_body("b", [punch, deck])
    assert (found.stiffness[0], found.mass[0], found.geometry) == (punch, punch, deck)


def test_bodies_are_joined_where_they_coincide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm and a panel meet at one node; the joined frequencies are those of the assembled matrices."""
    monkeypatch.chdir(tmp_path)
    left, right = arm(), panel()
    for body, (matrices, grids) in ((left, ("u", "v")), (right, ("w", "x"))):
        write_body(tmp_path, body)
        Path(f"{body.name}.op4").rename(matrices)
        Path(f"{body.name}.bdf").rename(grids)
    code, said = typed("new", "scene", "u", "v", "w", "x")
    assert (code, "warning" in said) == (0, False)
    keys = load_pipeline(Path("scene.yaml"))
    assert keys.scene.joints["v_x"].connect == ("v.to_x", "x.to_v")
    assert (keys.components["v"].interfaces["to_x"].node, keys.components["x"].interfaces["to_v"].node) == (5, 1)
    assert typed("run", "scene.yaml", "--quiet") == (0, "")
    # Node 5 of the arm is node 1 of the panel.
    n, at = left.n, left.dofs.rows_of(5, range(1, 7))
    T = np.zeros((n + right.n, n + right.n - 6))
    T[:n, :n] = np.eye(n)
    shared = right.dofs.rows_of(1, range(1, 7))
    T[n + shared, at] = 1.0
    T[n + np.setdiff1d(np.arange(right.n), shared), np.arange(n, T.shape[1])] = 1.0
    pairs = ((left.K, right.K), (left.M, right.M))
    K, M = (T.T @ la.block_diag(*(each.toarray() for each in pair)) @ T for pair in pairs)
    hz = np.sqrt(la.eigvalsh(K, M)[6:12]) / (2 * np.pi)
    reduced = system_frequencies(Path("build/scene/system.h5"))[6:12]
    # The limit on frequencies that the draft sets.
    np.testing.assert_allclose(reduced, hz, rtol=1e-3)


def moved(body: FEModel, x: float) -> FEModel:
    return replace(body, nodes=replace(body.nodes, xyz=body.nodes.xyz + np.array([x, 0, 0])))


def test_bodies_that_do_not_meet_are_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for body in (arm(), moved(panel(), 0.01)):
        write_body(tmp_path, body)
    draft = draft_pipeline("scene", [Path(f"{name}.{kind}") for name in ("arm", "panel") for kind in ("op4", "bdf")])
    words = "the nearest are its node 5 and node 1 of 'panel', 0.01 m apart: move a body with `place:`"
    assert len(draft.warnings) == 1 and words in draft.warnings[0]


def test_bodies_in_coordinates_of_their_own_are_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two arms of one mesh that both begin at the origin; the second is heavier."""
    monkeypatch.chdir(tmp_path)
    write_body(tmp_path, arm())
    write_body(tmp_path, replace(arm(), name="second", M=2 * arm().M))
    draft = draft_pipeline("scene", [Path(f"{name}.{kind}") for name in ("arm", "second") for kind in ("op4", "bdf")])
    assert "have 5 nodes in the same places, as if each had coordinates of its own" in draft.warnings[0]


@pytest.mark.parametrize("cells", [(2, 2, 2), (2, 3, 3)])
def test_solids_share_a_face(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cells: tuple[int, int, int]) -> None:
    """Two blocks make one of twice the length: a few nodes are joined one by one, more are tied."""
    monkeypatch.chdir(tmp_path)
    sides = (0.1, 0.06, 0.1)
    for body in (block("left", sides, cells), block("right", sides, cells, origin=(0.1, 0, 0))):
        write_body(tmp_path, body)
    code, _ = typed("new", "pair", "left.op4", "right.op4", "right.bdf", "left.bdf")
    assert code == 0
    parts = load_pipeline(Path("pair.yaml")).components
    near, far = parts["left"].interfaces["to_right"], parts["right"].interfaces["to_left"]
    assert (near.nodes, far.nodes) == (tuple(face(cells, 2)), tuple(face(cells, 0)))
    assert near.tie == far.tie == (None if cells == (2, 2, 2) else "rigid")
    assert typed("run", "pair.yaml", "--until", "assemble", "--quiet") == (0, "")
    whole = block("whole", (0.2, 0.06, 0.1), (4, *cells[1:]))
    hz = np.sqrt(la.eigvalsh(whole.K.toarray(), whole.M.toarray(), subset_by_index=[6, 8])) / (2 * np.pi)
    reduced = system_frequencies(Path("build/pair/system.h5"))[6:9]
    # Ties stiffen, and modes are left out: frequencies from above.
    assert (reduced >= hz * (1 - 1e-9)).all()
    if near.tie is None:
        np.testing.assert_allclose(reduced, hz, rtol=1e-3)


def test_a_body_on_the_ground_is_grounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Springs hold the first section of a block; the deck does not say it, and the other nodes are still proven."""
    monkeypatch.chdir(tmp_path)
    cells = (5, 2, 2)
    body = block("post", (0.4, 0.06, 0.1), cells)
    springs = np.zeros(body.n)
    springs[np.isin(body.dofs.node, face(cells, 0))] = 1e9
    write_body(tmp_path, replace(body, K=sp.csc_array(body.K + sp.diags_array(springs))))
    draft = draft_body("post", [Path("post.op4"), Path("post.bdf")])
    assert (draft.grounded, draft.remark, draft.units_remark) == (True, "", "")
    assert "grounded: true    # CHECK" in draft_pipeline("post", [Path("post.op4"), Path("post.bdf")]).text


@pytest.mark.parametrize(
    ("mass", "cause"),
    [
        ("KAA", r"the stiffness and the mass \(.*arm\.op4\) are exchanged"),
        ("MAA", r"the mass \(.*\) is given as stiffness"),
    ],
)
def test_a_run_says_that_the_matrices_are_exchanged(tmp_path: Path, mass: str, cause: str) -> None:
    write_body(tmp_path, arm())
    with pytest.raises(DofMapError, match=f"body 'arm': {cause}"):
        cms.read_body(
            "arm",
            stiffness=(tmp_path / "arm.op4", "MAA"),
            mass=(tmp_path / "arm.op4", mass),
            geometry=tmp_path / "arm.bdf",
        )


@pytest.mark.parametrize("trusted", [False, True])
def test_a_run_says_that_the_stiffness_is_given_as_mass(tmp_path: Path, trusted: bool) -> None:
    write_body(tmp_path, arm())
    matrix = (tmp_path / "arm.op4", "KAA")
    with pytest.raises(MatrixError, match=r"the stiffness \(.*arm\.op4\) is given as mass, too"):
        cms.read_body("arm", stiffness=matrix, mass=matrix, geometry=tmp_path / "arm.bdf", rows_trusted=trusted)


@pytest.mark.parametrize(("edge", "tie"), [(False, "rigid"), (True, "average")])
def test_a_tie_that_would_make_another_body_is_an_average(edge: bool, tie: str) -> None:
    """A thin plate with all its edges in one set, and with one of them."""
    body = block("plate", (0.1, 0.1, 0.01), (3, 3, 1))
    at, xyz = body.nodes.id, body.nodes.xyz[:, :2]
    ends = np.isin(xyz, (xyz.min(), xyz.max())) if edge else xyz[:, :1] == xyz.min()
    place = Place("rim", "{set: RIM, tie: rigid}", tuple(at[ends.any(axis=1)].tolist()), "set", tied=True)
    hz = np.sqrt(la.eigvalsh(body.K.toarray(), body.M.toarray(), subset_by_index=[6, 6])[0]) / (2 * np.pi)
    found = softly_tied(place, body, float(hz), 1.0)
    assert found.interface == f"{{set: RIM, tie: {tie}}}" and ("raises the first elastic mode" in found.words) is edge


def test_lone_nodes_come_before_faces() -> None:
    """A brick with a node beside it."""
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    lone = DofTable(np.full(6, 99), np.arange(1, 7))
    xyz = np.vstack([body.nodes.xyz, [0.5, 0, 0]])
    body = replace(
        body,
        K=sp.block_diag([body.K, sp.eye_array(6)], format="csc"),
        M=sp.block_diag([body.M, sp.eye_array(6)], format="csc"),
        dofs=body.dofs.joined(lone),
        nodes=Nodes.in_basic(np.append(body.nodes.id, 99), xyz),
    )
    cells = {"hexahedron": np.array([[1, 5, 7, 3, 2, 6, 8, 4]])}
    places = proposed_interfaces(body, cells)
    assert [place.name for place in places] == ["node_99", "face_1", "face_2", "face_3", "face_4", "face_5"]
    assert places[0].words == "lone node with six dofs, at [0.5, 0, 0]"
    # The faces farthest from the centre are the ends of the longer sides.
    assert sorted(places[1].nodes) in ([1, 2, 3, 4], [5, 6, 7, 8], [1, 3, 5, 7], [2, 4, 6, 8])
    sets = {"end 1": np.array([1, 2, 3, 4]), "TIP": np.array([8]), "ALL": np.arange(1, 9)}
    named = proposed_interfaces(body, cells, sets)
    assert [(place.name, place.interface) for place in named[:3]] == [
        ("node_99", "{node: 99}"),
        ("TIP", "{set: TIP}"),
        ("end_1", '{set: "end 1", tie: rigid}'),
    ]
    # A face that a set names, too, is there once, by its name.
    assert named[2].words.startswith("flat face of area 0.006")
    assert sum(set(place.nodes) == {1, 2, 3, 4} for place in named) == 1
    assert "ALL" not in [place.name for place in named]
