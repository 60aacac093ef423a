"""Rounding of K by any source is no fault of the row order; a fault is found in any rounding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, Nodes, rigid_body_shapes, rounding_of_values
from cmsreduce.read import MatrixSource, prove_row_order, read_body
from cmsreduce.read.row_order import is_condensed
from tests.frames import Section, frame
from tests.hard.numbers import PAIRS, TRUSS
from tests.hard.structures import bars
from tests.solids import block

BODIES: dict[str, Callable[[], FEModel]] = {
    "solid": lambda: block("solid", [1.1, 0.23, 0.17], [11, 3, 2]),
    "frame": lambda: bars("frame", TRUSS, PAIRS),
    "mast": lambda: bars("mast", np.linspace([0, 0, 0], [3.1, 1.3, 0.7], 41), [(k, k + 1) for k in range(1, 41)]),
}


def with_values(K: sp.csc_array, values: np.ndarray) -> sp.csc_array:
    return sp.csc_array((values, K.indices, K.indptr), shape=K.shape)


def decimal(K: sp.csc_array) -> sp.csc_array:
    return with_values(K, np.array([float(f"{x:.9e}") for x in K.data]))


def cancelled(level: float) -> Callable[[sp.csc_array], sp.csc_array]:
    """Noise of single entries relative to sqrt(K_ii K_jj), symmetric."""

    def spoil(K: sp.csc_array) -> sp.csc_array:
        own = np.sqrt(K.diagonal())
        column = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
        draw = level * np.random.default_rng(5).standard_normal(K.nnz) * own[K.indices] * own[column]
        noisy = with_values(K, K.data + draw)
        return sp.csc_array((noisy + noisy.T) / 2)

    return spoil


def own_noise(K: sp.csc_array) -> sp.csc_array:
    """Noise that leaves every row a force of one sign: all elements of a mesh are rounded alike."""
    return sp.csc_array(K + 3.4e-13 * sp.diags_array(K.diagonal()))


NOISES: dict[str, tuple[Callable[[sp.csc_array], sp.csc_array], float]] = {
    "single precision": (lambda K: with_values(K, np.float64(np.float32(K.data))), 6e-8),
    "ten digits": (decimal, 5e-10),
    "a solver's noise": (cancelled(3.4e-13), 3.4e-13),
    "equal elements": (own_noise, 3.4e-13),
    "condensation": (cancelled(1e-9), 1e-9),
}


def as_stored(body: FEModel, K: sp.csc_array) -> FEModel:
    """The body with another K and the rounding that its reader sees."""
    return replace(body, K=K, rounding=rounding_of_values(K.data))


EACH_BODY = pytest.mark.parametrize("make", BODIES.values(), ids=BODIES)
EACH_NOISE = pytest.mark.parametrize(("spoil", "size"), NOISES.values(), ids=NOISES)


def test_single_precision_is_seen_beside_what_cancelled():
    long = np.random.default_rng(3).standard_normal(40).astype(np.float32)
    left = 2.0**-52 * np.arange(1, 60)  # Entries of a mesh along the axes that should be zero.
    assert rounding_of_values(np.float64(np.concatenate([long, left]))) == 2.0**-24
    assert rounding_of_values(np.concatenate([np.float64(long[:2]), left])) == 2.0**-53
    # A penalty hides nothing, either.
    assert rounding_of_values(np.float64(np.append(long, np.float32(1e20)))) == 2.0**-24


@pytest.mark.parametrize(("seed", "thick"), [(1, 0.1), (7, 0.1), (10, 0.1)])
def test_a_condensed_frame_on_printed_places_has_six_motions(seed: int, thick: float) -> None:
    """Ten digits of the places leave forces; energy, in which they are of second order, shows the noise of K."""
    bar = Section(A=thick**2, Iy=thick**4 / 12, Iz=thick**4 / 12, J=thick**4 / 7)
    xyz = np.cumsum(np.random.default_rng(seed).uniform(-0.1, 0.1, (12, 3)), axis=0)
    whole = frame("frame", xyz.tolist(), [(k, k + 1) for k in range(1, 12)], section=bar)
    kept, K, M = np.isin(whole.dofs.node, [1, 6, 12]), whole.K.toarray(), whole.M.toarray()
    T = np.eye(whole.n)[:, kept]
    T[~kept] = -np.linalg.solve(K[np.ix_(~kept, ~kept)], K[np.ix_(~kept, kept)])
    K, M = (sp.csc_array(T.T @ (A + A.T) @ T / 2) for A in (K, M))
    nodes = replace(whole.nodes, xyz=np.array([[float(f"{x:.9e}") for x in at] for at in xyz]), xyz_rounding=5e-11)
    body = FEModel("frame", K, M, whole.dofs[np.flatnonzero(kept)], nodes, {})
    body = prove_row_order(body).estimated(body)
    R = rigid_body_shapes(body.dofs, body.nodes, nodes.xyz.mean(axis=0))
    assert rigid_body_modes(body.K, body.M, R, body.stiffness_rounding, "frame").shape[1] == 6


@pytest.mark.parametrize(
    ("components", "condensed"),
    [((), True), ((4, 5, 6), True), ((3, 4, 5), True), ((1, 2, 3, 4, 5, 6), False)],
    ids=str,
)
def test_nodes_without_rows_are_condensed_unless_they_are_held(components: tuple[int, ...], condensed: bool) -> None:
    whole = BODIES["frame"]()
    inner = whole.dofs.node == whole.nodes.id[2]
    held = DofTable(np.full(len(components), whole.nodes.id[2]), np.array(components, dtype=np.int64))
    kept = np.flatnonzero(~inner)
    K, M = (sp.csc_array(A[kept][:, kept]) for A in (whole.K, whole.M))
    body = FEModel("frame", K, M, whole.dofs[kept], whole.nodes, {}, constrained=held if components else None)
    assert is_condensed(body) == condensed


@pytest.mark.parametrize("components", [(6,), (4, 5, 6), (3, 4, 5)], ids=str)
def test_one_spare_node_that_is_held_in_part_makes_no_body_condensed(components: tuple[int, ...]) -> None:
    """A grid that orients bars, under GRDSET: a soft spring to ground would pass for noise of condensation."""
    xyz = np.array([[k, 0.2 * (k % 3), 0.1 * (k % 2)] for k in range(13)], dtype=float)
    whole = frame("frame", xyz[:12], [(k, k + 1) for k in range(1, 12)])
    spare = DofTable(np.full(len(components), 13), np.array(components, dtype=np.int64))
    nodes = Nodes.in_basic(np.arange(1, 14), xyz)
    assert not is_condensed(replace(whole, nodes=nodes, constrained=spare))


@EACH_BODY
@EACH_NOISE
def test_noise_that_no_file_states_is_measured(make, spoil, size):
    body = make()
    noisy = as_stored(body, spoil(body.K))
    proof = prove_row_order(noisy)
    assert (proof.status, proof.motions) == ("proven", 6)
    found = proof.estimated(noisy)
    assert size / 30 < found.stiffness_rounding < 30 * size
    assert proof.noise <= 30 * size
    assert proof.residual <= proof.tolerance < 1e-5


@EACH_BODY
@EACH_NOISE
def test_the_count_of_rigid_motions_agrees_with_the_proof(make, spoil, size):
    body = make()
    noisy = as_stored(body, spoil(body.K))
    found = prove_row_order(noisy).estimated(noisy)
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    assert rigid_body_modes(found.K, found.M, R, found.stiffness_rounding, "b").shape[1] == 6


@EACH_BODY
@EACH_NOISE
@pytest.mark.parametrize("pair", [(1, 9), (4, 5)])
def test_exchanged_nodes_are_found_in_any_noise(make, spoil, size, pair):
    body = make()
    rows = np.arange(body.n)
    a, b = (np.flatnonzero(body.dofs.node == node) for node in pair)
    rows[a], rows[b] = b, a
    with pytest.raises(DofMapError, match="rigid motion must cost no force"):
        prove_row_order(as_stored(body, spoil(body.K)[rows][:, rows]))


@EACH_BODY
@EACH_NOISE
def test_a_shuffled_matrix_is_found_in_any_noise(make, spoil, size):
    body = make()
    rows = np.random.default_rng(2).permutation(body.n)
    with pytest.raises(DofMapError, match="rigid motion must cost no force"):
        prove_row_order(as_stored(body, spoil(body.K)[rows][:, rows]))


@EACH_BODY
@EACH_NOISE
def test_a_spring_to_ground_is_found_above_the_noise(make, spoil, size):
    body = make()
    row = int(body.dofs.rows(3, [2])[0])
    spring = sp.csc_array(([1e4 * size * body.K[row, row]], ([row], [row])), shape=body.K.shape)
    with pytest.raises(DofMapError, match=r"1 of .* nodes resist.*node 3 is held to the ground"):
        prove_row_order(replace(as_stored(body, spoil(body.K)), K=spoil(body.K) + spring))


@EACH_BODY
@pytest.mark.parametrize("level", [1e-8, 1e-7, 1e-4])
def test_springs_under_all_nodes_are_no_noise(make, level):
    body = make()
    ground = level * sp.diags_array(np.where(body.dofs.component == 3, body.K.diagonal(), 0.0))
    with pytest.raises(DofMapError, match="rigid motion must cost no force"):
        prove_row_order(replace(body, K=sp.csc_array(body.K + ground)))


@EACH_BODY
def test_files_show_their_digits_whatever_their_type(make, tmp_path: Path):
    body = make()
    rows = tmp_path / "rows.txt"
    rows.write_text("".join(f"{label}\n" for label in body.dofs.labels))
    for name, spoil, rounding in (
        ("single", NOISES["single precision"][0], 2.0**-24),
        ("ten", decimal, 5e-11),
        ("double", lambda K: K, 2.0**-53),
    ):
        sp.save_npz(tmp_path / f"{name}.npz", spoil(body.K))
        source = MatrixSource(tmp_path / f"{name}.npz")
        assert read_body("b", stiffness=source, mass=source, rows=rows).rounding == rounding, name


def test_exact_numbers_are_not_rounded(tmp_path: Path):
    """Powers of two, integers and typed numbers are exact in single precision and in few digits."""
    rows = tmp_path / "rows.txt"
    rows.write_text("".join(f"{node}.0\n" for node in range(1, 13)))
    for values in (2.0 ** np.arange(12), 1000.0 * np.arange(1, 13), np.linspace(0.1, 1.2, 12), 1e9 + np.arange(12.0)):
        np.save(tmp_path / "K.npy", np.diag(values))
        source = MatrixSource(tmp_path / "K.npy")
        assert read_body("b", stiffness=source, mass=source, rows=rows).rounding == 2.0**-53


def test_typed_masses_say_nothing_of_the_stiffness(tmp_path: Path):
    rows = tmp_path / "rows.txt"
    rows.write_text("".join(f"{node}.0\n" for node in range(1, 7)))
    np.save(tmp_path / "M.npy", np.diag([0.123456, 1.234561, 2.345671, 34.56789, 45.67891, 5.678912]))
    np.save(tmp_path / "K.npy", np.diag(np.sqrt(np.arange(2.0, 8.0))))
    stiffness, mass = (MatrixSource(tmp_path / f"{name}.npy") for name in "KM")
    assert read_body("b", stiffness=stiffness, mass=mass, rows=rows).rounding == 2.0**-53


@pytest.mark.parametrize("digits", [12, 14, 17])
def test_single_precision_is_seen_in_text(digits: int):
    """Text of 12 to 16 digits is no single-precision number to the last bit. A mesh along the axes has forces of one
    sign, which are no noise."""
    body = block("solid", [1.6, 0.2, 0.1], [8, 2, 2])
    printed = np.array([float(f"{x:.{digits}e}") for x in body.K.data.astype(np.float32)])
    assert rounding_of_values(printed) == 2.0**-24
    assert rounding_of_values(np.array([float(f"{x:.{digits}e}") for x in body.K.data])) < 1e-10


@pytest.mark.parametrize("times", [-1e4, -10.0, 10.0, 1e4])
@pytest.mark.parametrize("make", [BODIES["solid"], BODIES["frame"]], ids=["solid", "frame"])
def test_a_multiple_of_the_mass_in_the_stiffness_is_named(make, times: float):
    """Spin takes omega^2 M away, a solver's shift adds it; below the noise of condensation only the former passed."""
    body = make()
    scale = 1e-8 * body.K.diagonal().max() / body.M.diagonal().max()
    with pytest.raises(DofMapError, match=r"the stiffness holds .* times the mass: (spin of|an eigenvalue)") as named:
        prove_row_order(replace(body, K=sp.csc_array(body.K + times * scale * body.M)))
    assert ("spin of" in str(named.value)) == (times < 0)


@pytest.mark.parametrize("error", ["digits", "entries"])
def test_forces_barely_beyond_round_off_are_not_those_of_the_mass(error: str):
    """A few rows beyond their round-off, which the mass does not explain, were called 4e4 times the mass."""
    body = block("solid", [1.0, 0.1, 0.15], (4, 2, 2))
    if error == "digits":
        printed = body.K.copy()
        printed.data = np.array([float(f"{x:.4e}") for x in printed.data])
        wrong, words = replace(body, K=printed, rounding=5e-7), "rounded to 5 digits"
    else:
        some = sp.random_array(body.K.shape, density=0.0005, rng=np.random.default_rng(0))
        wrong, words = replace(body, K=sp.csc_array(body.K + 3e-14 * body.K.max() * (some + some.T))), "Likely cause"
    with pytest.raises(DofMapError, match=words) as named:
        prove_row_order(wrong)
    assert "times the mass" not in str(named.value)


@pytest.mark.parametrize("digits", [6, 7, 8])
def test_decimals_of_few_different_numbers_are_those_of_a_text(digits: int):
    """Digits of a text saved as binary: half of the few numbers of a straight beam are short."""
    body = bars("spar", np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0], [4.4, 0, 0]]), [(1, 2), (2, 3), (3, 4)])
    K = with_values(body.K, np.array([float(f"{x:.{digits - 1}e}") for x in body.K.data]))
    stored, printed = replace(body, K=K), replace(body, K=K, rounding=0.5 * 10.0**-digits)
    assert rounding_of_values(K.data) == 2.0**-53
    assert str(prove_row_order(stored)) == str(prove_row_order(printed))
    assert prove_row_order(stored).estimated(stored).rounding == printed.rounding
    order = np.r_[:6, 12:18, 6:12, 18:24]
    spring = sp.csc_array(([100 * printed.rounding * K[8, 8]], ([8], [8])), shape=K.shape)
    for wrong in (sp.csc_array(K[order][:, order]), sp.csc_array(K + spring)):
        with pytest.raises(DofMapError, match="is not proven"):
            prove_row_order(replace(body, K=wrong))
