"""Bodies read from their files, row labels from every source, and the real bodies."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError, ReadError, SceneError
from cmsreduce.model import Damping, FEModel, Units, rigid_body_shapes
from cmsreduce.read import InterfaceSpec, MatrixSource, prove_row_order, read_body

Frame = Callable[..., FEModel]


def market(path: Path, A: sp.csc_array) -> MatrixSource:
    scipy.io.mmwrite(path, sp.coo_array(A), precision=17, symmetry="general")
    return MatrixSource(path)


def grids(body: FEModel) -> list[str]:
    assert body.nodes is not None
    return [
        f"GRID,{id},,{x!r},{y!r},{z!r}" for id, (x, y, z) in zip(body.nodes.id, body.nodes.xyz.tolist(), strict=True)
    ]


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def dmig(name: str, A: NDArray[np.float64], labels: list[str]) -> list[str]:
    """Symmetric DMIG, double precision, lower triangle by columns, empty columns left out."""
    out = [f"DMIG,{name},0,6,2,0,,,{len(labels)}"]
    split = [label.split(".") for label in labels]
    for j, (node, component) in enumerate(split):
        entries = [(split[i], A[i, j]) for i in range(j, len(labels)) if A[i, j]]
        if entries:
            out.append(f"DMIG*,{name},{node},{component}")
            out += [f"*,{i},{c},{float(value)!r}" for (i, c), value in entries]
    return out


ROD = np.kron(np.array([[1.0, -1], [-1, 1]]), np.diag([5.0, 0, 0]))
"""A rod along x between two nodes, translations only."""


def test_a_deck_gives_rows_frames_sets_and_interfaces(tmp_path: Path, space_frame: Frame) -> None:
    turned = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    frame = space_frame({25: turned})
    lines = grids(frame)
    lines = [line + ",10" if line.startswith("GRID,25,") else line for line in lines]
    deck = write(tmp_path / "b.bdf", [*lines, "CORD2R,10,0,0.,0.,0.,1.,0.,0.", "+,0.,1.,0.", "INCLUDE 'sets.bdf'"])
    write(tmp_path / "sets.bdf", ["BSET1,123456,1,3", "ASET1,123456,1,THRU,99"])
    body = read_body(
        "b",
        stiffness=market(tmp_path / "k.mtx", frame.K),
        mass=market(tmp_path / "m.mtx", frame.M),
        geometry=deck,
        damping=Damping(modal=0.01),
        units=Units.parse("mm-t-s"),
        interfaces={"root": InterfaceSpec(set="b"), "tip": InterfaceSpec(nodes=(25,), dofs="456")},
    )
    assert body.dofs.labels == frame.dofs.labels
    assert abs(body.K - frame.K).max() == 0
    assert {name: rows.size for name, rows in body.sets.items()} == {"a": 36, "f": 36, "n": 36, "g": 36, "b": 12}
    np.testing.assert_array_equal(body.interface_rows("root"), np.arange(12))
    np.testing.assert_allclose(body.interfaces["tip"].frame, turned, atol=1e-15)
    assert (body.units.length, body.damping.modal, body.constrained) == (1e-3, 0.01, None)
    held = {Path(source.path).name: source.holds for source in body.sources}
    assert held == {"k.mtx": "stiffness k", "m.mtx": "mass m", "b.bdf": "geometry", "sets.bdf": "geometry"}
    assert body.sources[0].sha256 == hashlib.sha256((tmp_path / "k.mtx").read_bytes()).hexdigest()


def test_a_dof_list_goes_before_the_deck(tmp_path: Path, space_frame: Frame) -> None:
    frame = space_frame()
    order = np.random.default_rng(5).permutation(frame.n)
    stiffness, mass = (market(tmp_path / f"{x}.mtx", A[order][:, order]) for x, A in (("k", frame.K), ("m", frame.M)))
    deck = write(tmp_path / "b.bdf", grids(frame))
    rows = write(tmp_path / "order.txt", [frame.dofs.labels[i] for i in order])
    with pytest.raises(DofMapError, match="shuffled or of another set"):
        read_body("b", stiffness=stiffness, mass=mass, geometry=deck)
    for given in (rows, str(rows)):
        body = read_body("b", stiffness=stiffness, mass=mass, geometry=deck, rows=given)
        assert body.dofs.labels == [frame.dofs.labels[i] for i in order]
        assert body.sources[-1].holds == "row order"


def test_the_set_of_matching_size_that_is_proven_is_taken(tmp_path: Path) -> None:
    deck = write(tmp_path / "b.bdf", ["GRID,1,,0.,0.,0.", "GRID,2,,4.,0.,0.", "ASET1,123456,1"])
    stiffness = market(tmp_path / "k.mtx", sp.csc_array(ROD))
    mass = market(tmp_path / "m.mtx", sp.csc_array(np.eye(6)))
    tip = {"tip": InterfaceSpec(nodes=(2,))}
    body = read_body("rod", stiffness=stiffness, mass=mass, geometry=deck, interfaces=tip)
    assert body.dofs.labels == ["1.1", "1.2", "1.3", "2.1", "2.2", "2.3"]
    assert body.interfaces["tip"].components == ((1, 2, 3),)
    with pytest.raises(DofMapError, match="1 of 1 nodes resist"):
        read_body("rod", stiffness=stiffness, mass=mass, geometry=deck, rows="a")
    assert read_body("rod", stiffness=stiffness, mass=mass, geometry=deck, rows="translations").n == 6


def test_constraints_of_the_deck_have_no_rows(tmp_path: Path, space_frame: Frame) -> None:
    frame = space_frame()
    kept = np.flatnonzero(~((frame.dofs.node == 3) & np.isin(frame.dofs.component, [1, 2, 3])))
    deck = write(tmp_path / "b.bdf", [*grids(frame), "SPC1,1,123,3"])
    body = read_body(
        "b",
        stiffness=market(tmp_path / "k.mtx", frame.K[kept][:, kept]),
        mass=market(tmp_path / "m.mtx", frame.M[kept][:, kept]),
        geometry=deck,
    )
    assert body.constrained is not None
    assert body.constrained.labels == ["3.1", "3.2", "3.3"]
    assert prove_row_order(body).motions == 3
    free = read_body(
        "b", stiffness=market(tmp_path / "k.mtx", frame.K), mass=market(tmp_path / "m.mtx", frame.M), geometry=deck
    )
    assert (free.n, free.constrained, prove_row_order(free).motions) == (36, None, 6)


def test_punch_files_may_leave_out_empty_rows_of_either_matrix(tmp_path: Path) -> None:
    labels = ["1.1", "1.2", "2.1", "2.2"]
    K = np.array([[5.0, 0, -5, 0], [0, 0, 0, 0], [-5, 0, 5, 0], [0, 0, 0, 0]])
    punch = write(tmp_path / "p.pch", dmig("KAAX", K, labels) + dmig("MAAX", np.diag([0.0, 3, 2, 3]), labels))
    deck = write(tmp_path / "b.bdf", ["GRID,1,,0.,0.,0.", "GRID,2,,4.,0.,0."])
    sources = {"stiffness": MatrixSource(punch, "KAAX"), "mass": MatrixSource(punch, "MAAX")}
    body = read_body("rod", **sources, geometry=deck)
    assert body.dofs.labels == labels
    np.testing.assert_array_equal(body.K.toarray(), K)
    np.testing.assert_array_equal(body.M.diagonal(), [0, 3, 2, 3])
    with pytest.raises(MatrixError, match=r"'MAAX' of .*p.pch has 2 dofs that 'KAAX' .*lacks, the first is 1.2"):
        read_body("rod", **sources)
    assert read_body("rod", **sources, geometry=deck, rows="g").n == 12


def test_labelled_matrices_in_different_order_meet(tmp_path: Path) -> None:
    labels = ["1.1", "2.1", "3.1"]
    K = np.array([[2.0, -2, 0], [-2, 5, -3], [0, -3, 3]])
    punch = write(tmp_path / "p.pch", dmig("KAAX", K, labels))
    order = write(tmp_path / "order.txt", ["3.1", "1.1", "2.1"])
    mass = market(tmp_path / "m.mtx", sp.csc_array(np.diag([30.0, 10, 20])))
    body = read_body("chain", stiffness=MatrixSource(punch), mass=mass, rows=order)
    assert body.dofs.labels == ["3.1", "1.1", "2.1"]
    np.testing.assert_array_equal(body.M.diagonal(), [30, 10, 20])
    np.testing.assert_array_equal(body.K.toarray(), K[np.ix_([2, 0, 1], [2, 0, 1])])


def test_a_damping_matrix_is_put_on_the_same_rows(tmp_path: Path) -> None:
    labels = ["1.1", "2.1"]
    K, D = np.array([[2.0, -2], [-2, 2]]), np.array([[0.0, 0], [0, 7.0]])
    lines = dmig("KAAX", K, labels) + dmig("MAAX", np.eye(2), labels) + dmig("BAAX", D, labels)
    punch = write(tmp_path / "p.pch", lines)
    body = read_body(
        "chain",
        stiffness=MatrixSource(punch, "KAAX"),
        mass=MatrixSource(punch, "MAAX"),
        damping_matrix=MatrixSource(punch, "BAAX"),
    )
    assert body.D is not None
    np.testing.assert_array_equal(body.D.toarray(), D)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"mass": 5}, MatrixError, r"different size: 'k' of .*k.mtx is 6 x 6, 'm' of .*m.mtx is 5 x 5"),
        ({"geometry": None}, DofMapError, r"the dofs of the 6 rows of 'k' in .*k.mtx are unknown; give `geometry:`"),
        ({"stiffness": 7}, DofMapError, r"'k' of .*k.mtx has 7 rows, .*no dof set of .*a 12, f 12, n 12, g 12, transl"),
        (
            {"stiffness": 30},
            DofMapError,
            r"of no dof set .*Give the deck that made the matrix, or `rows:`, a list of node.component, one a line$",
        ),
        ({"rows": "b"}, DofMapError, r"there is no dof set 'b'; its sets and their sizes are a \(12\)"),
        ({"rows": "asett"}, DofMapError, r"there is no dof set 'asett'; its sets and their sizes are a \(12\)"),
        ({"rows": "g"}, DofMapError, r"has 6 rows, but set 'g' of .*b.bdf has 12"),
        ({"rows": "g", "geometry": None}, DofMapError, "`rows: g` names a dof set, which needs `geometry:`"),
        ({"rows": "gone.txt"}, ReadError, "gone.txt: the dof list cannot be read"),
        ({"interfaces": {"root": InterfaceSpec(nodes=(9,))}}, SceneError, "interface 'root': there is no node 9"),
    ],
)
def test_what_does_not_fit_is_refused(
    tmp_path: Path, changes: dict[str, object], error: type[Exception], message: str
) -> None:
    def sized(name: str, A: NDArray[np.float64], n: object) -> MatrixSource:
        size = n if isinstance(n, int) else 6
        B = np.zeros((size, size))
        B[: min(size, 6), : min(size, 6)] = A[:size, :size]
        return market(tmp_path / f"{name}.mtx", sp.csc_array(B))

    given: dict[str, object] = {"geometry": write(tmp_path / "b.bdf", ["GRID,1", "GRID,2,,4."]), **changes}
    given["stiffness"] = sized("k", ROD, changes.get("stiffness"))
    given["mass"] = sized("m", np.eye(6), changes.get("mass"))
    with pytest.raises(error, match=message):
        read_body("rod", **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize(("factor", "more"), [(1.6, True), (2.7, True), (5.4, True), (0.9, False)])
def test_a_mesh_of_corners_alone_is_named_beside_elements_of_second_order(
    tmp_path: Path, high: bool, factor: float, more: bool
) -> None:
    """In a plane, 7 x 7 corners have 133 nodes of quad8 in two rows each, which are less than six at each corner."""
    x, y = np.meshgrid(np.arange(7.0), np.arange(7.0))
    xyz = np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()])
    corner = (np.arange(6)[:, None] * 7 + np.arange(6)).ravel()
    cells = [("quad", corner[:, None] + [0, 1, 8, 7])]
    if high:
        cells = [("hexahedron", np.hstack([cells[0][1], cells[0][1] + 49]))]
        xyz = np.vstack([xyz, np.add(xyz, (0.0, 0, 1))])
    meshio.Mesh(xyz, cells).write(tmp_path / "a.vtu")
    n = int(factor * (3 if high else 2) * len(xyz))
    K = market(tmp_path / "k.mtx", sp.eye_array(n, format="csc"))
    with pytest.raises(DofMapError, match=f"has {n} rows.*Give the deck") as refusal:
        read_body("a", stiffness=K, mass=K, geometry=tmp_path / "a.vtu")
    assert (
        "; with elements of second order the mesh must have the nodes between corners" in str(refusal.value)
    ) == more


def test_a_deck_of_points_has_no_corners(tmp_path: Path) -> None:
    """Rows beyond six for each grid are those of scalar points; a mesh was asked for in place of the deck."""
    deck = write(tmp_path / "b.bdf", ["GRID,1", "GRID,2,,4.", "SPOINT,101,THRU,150", "ASET1,0,101,THRU,150"])
    K = market(tmp_path / "k.mtx", sp.eye_array(40, format="csc"))
    with pytest.raises(DofMapError, match=r"has 40 rows.*Give the deck that made the matrix, or `rows:`[^;]*$"):
        read_body("a", stiffness=K, mass=K, geometry=deck)


def test_a_rectangular_matrix_is_refused(tmp_path: Path) -> None:
    deck = write(tmp_path / "b.bdf", ["GRID,1", "GRID,2,,4."])
    tall = market(tmp_path / "k.mtx", sp.csc_array(np.ones((6, 5))))
    with pytest.raises(MatrixError, match=r"'k' of .*k.mtx is 6 x 5; matrices of a body are square"):
        read_body("rod", stiffness=tall, mass=tall, geometry=deck)


@pytest.mark.parametrize(("rows", "cols", "why"), [(0, 0, "it is empty"), (1, 0, "square"), (0, 3, "square")])
def test_an_empty_matrix_is_no_fault_of_the_geometry(tmp_path: Path, rows: int, cols: int, why: str) -> None:
    deck, path = write(tmp_path / "b.bdf", ["GRID,1", "GRID,2,,4."]), tmp_path / "k.npy"
    np.save(path, np.zeros((rows, cols)))
    for geometry in (deck, None):
        with pytest.raises(MatrixError, match=rf"'k' of .*k\.npy is {rows} x {cols}; .*{why}"):
            read_body("rod", stiffness=MatrixSource(path), mass=MatrixSource(path), geometry=geometry)


@pytest.mark.shared
@pytest.mark.parametrize(
    ("stiffness", "mass", "geometry", "n", "status", "motions", "at_most"),
    [
        ("block_a/block_a.op4:KAA", "block_a/block_a.op4:MAA", "block_a/block_a.bdf", 1575, "proven", 6, 1e-14),
        ("nas2cam/inboard.op4:kxx", "nas2cam/inboard.op4:mxx", "nas2cam/inboard.asm", 32, "proven", 6, 1e-12),
        ("nas2cam/outboard.op4:kxx", "nas2cam/outboard.op4:mxx", "nas2cam/outboard.pch", 46, "proven", 6, 1e-12),
        ("nas2cam/inboard.op4:kxx", "nas2cam/inboard.op4:mxx", "nas2cam/inboard.dat", 32, "proven", 6, 1e-12),
        (
            "swept_plane/sol103_swept_plane.pch1:KAAX",
            "swept_plane/sol103_swept_plane.pch1:MAAX",
            "swept_plane/sol103_swept_plane.bdf",
            *(45, "proven", 3, 5e-10),
        ),
        (
            "calculix_body/calculix.sti",
            "calculix_body/calculix.mas",
            "calculix_body/calculix.frd",
            *(783, "proven", 6, 1e-12),
        ),
        (
            "abaqus_c3d10/blockC3D10_STIF1.mtx",
            "abaqus_c3d10/blockC3D10_MASS1.mtx",
            "abaqus_c3d10/blockC3D10.inp",
            *(771, "proven", 6, 1e-14),
        ),
        ("chain15/dmig.pch:KAAX", "chain15/dmig.pch:MAAX", None, 15, "no geometry", 0, 0.0),
    ],
)
def test_real_bodies(
    shared_data: Path,
    stiffness: str,
    mass: str,
    geometry: str | None,
    n: int,
    status: str,
    motions: int,
    at_most: float,
) -> None:
    body = read_body(
        "body",
        stiffness=source(shared_data, stiffness),
        mass=source(shared_data, mass),
        geometry=None if geometry is None else shared_data / geometry,
    )
    proof = prove_row_order(body)
    assert (body.n, proof.status, proof.motions) == (n, status, motions)
    assert proof.residual <= at_most


def source(folder: Path, text: str) -> MatrixSource:
    file, _, name = text.partition(":")
    return MatrixSource(folder / file, name or None)


def nas2cam(folder: Path, name: str, **more: object) -> FEModel:
    return read_body(
        name,
        stiffness=MatrixSource(folder / f"nas2cam/{name}.op4", "kxx"),
        mass=MatrixSource(folder / f"nas2cam/{name}.op4", "mxx"),
        geometry=folder / f"nas2cam/{name}.asm",
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.shared
@pytest.mark.parametrize(("name", "q"), [("inboard", 8), ("outboard", 22)])
def test_external_superelements(shared_data: Path, name: str, q: int) -> None:
    body = nas2cam(shared_data, name, interfaces={"joint": InterfaceSpec(set="b")})
    assert {key: rows.size for key, rows in body.sets.items()} == {"b": 24, "q": q}
    assert body.interfaces["joint"].node.tolist() == [3, 11, 19, 27]
    assert body.nodes is not None
    # Grid 11 moves along CORD2R 10: x, y, z of the frame are y, z, x of basic.
    np.testing.assert_allclose(body.nodes.frame[body.nodes.index(11)[0]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    R /= np.abs(R).max(axis=0)
    assert np.abs(body.K @ R).max() < 1e-14 * np.abs(body.K).max()


@pytest.mark.shared
def test_mass_of_the_inboard_superelement(shared_data: Path) -> None:
    body = nas2cam(shared_data, "inboard")
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    np.testing.assert_allclose(R.T @ body.M @ R, 1.755052 * np.eye(3), atol=5e-7)


@pytest.mark.shared
def test_a_superelement_without_its_frame_is_refused(shared_data: Path, tmp_path: Path) -> None:
    path = tmp_path / "inboard.asm"
    text = (shared_data / "nas2cam" / "inboard.asm").read_text()
    path.write_text(
        text.replace(
            "              10               0               0", "               0               0               0"
        )
    )
    with pytest.raises(DofMapError, match="row order of the stiffness matrix"):
        read_body(
            "inboard",
            stiffness=MatrixSource(shared_data / "nas2cam/inboard.op4", "kxx"),
            mass=MatrixSource(shared_data / "nas2cam/inboard.op4", "mxx"),
            geometry=path,
        )


@pytest.mark.shared
def test_massless_dofs_of_the_plane_keep_their_rows(shared_data: Path) -> None:
    folder = shared_data / "swept_plane"
    punch = folder / "sol103_swept_plane.pch1"
    body = read_body(
        "plane",
        stiffness=MatrixSource(punch, "KAAX"),
        mass=MatrixSource(punch, "MAAX"),
        geometry=folder / "sol103_swept_plane.bdf",
    )
    assert body.dofs.labels[:4] == ["1.3", "1.4", "1.5", "2.3"]
    assert body.constrained is not None
    assert len(body.constrained) == 45
    empty = np.flatnonzero(abs(body.M).sum(axis=0) == 0)
    assert {body.dofs.labels[i] for i in empty} == {"1.4", "2.4", "3.4", "4.4"}


def test_unsound_matrices_are_named_before_an_interface_without_a_node(tmp_path: Path, space_frame: Frame) -> None:
    """A draft of files that do not fit has a mount of no body, which the run named in place of the cause."""
    frame = space_frame()
    labels, cut = list(frame.dofs.labels), frame.K.toarray()
    cut[-1, -1] = 0
    punch = write(tmp_path / "b.pch", dmig("K", cut, labels) + dmig("M", frame.M.toarray(), labels))
    files = {kind: MatrixSource(punch, kind[0].upper().replace("S", "K")) for kind in ("stiffness", "mass")}
    deck = write(tmp_path / "b.bdf", grids(frame))
    with pytest.raises(MatrixError, match="or where a file was cut"):
        read_body("b", **files, geometry=deck, interfaces={"mount": InterfaceSpec(nodes=(1_000_000,))})
    write(punch, dmig("K", frame.K.toarray(), labels) + dmig("M", frame.M.toarray(), labels))
    assert frame.nodes is not None
    write(deck, [*grids(frame), f"RBE2,9999,{frame.nodes.id[0]},123456,{frame.nodes.id[1]}"])
    with pytest.raises(DofMapError, match=r"has rows of 6 dofs that rigid elements or MPCs of .* make dependent"):
        read_body("b", **files, geometry=deck, interfaces={"mount": InterfaceSpec(nodes=(1_000_000,))})
