"""Truss of 143 rods, cut at the top of bay 6: an indeterminate interface and close modes (theory section 9)."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.assemble import assemble, modal_substructure, physical_substructure, system_modes
from cmsreduce.config import load_pipeline
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import Configuration, DofTable, FEModel, Interface, Joint, Nodes, Point, Scene, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.reduce import CraigBampton
from tests.samples import assert_made_again

SAMPLE = Path(__file__).parents[2] / "pipelines" / "truss.yaml"

COLUMNS, BAYS, BAY, E, A, RHO, CUT = 4, 11, 0.7, 70e9, 4e-4, 2710.0, 6
OMEGA = [120.06, 578.56, 602.01, 1305.4, 1778.9, 2078.9]
HIGHEST = 13561.9


def node(column: int, level: int) -> int:
    return 1 + column + COLUMNS * level


def rods() -> list[tuple[int, int, int]]:
    """Both ends and the bay each rod belongs to."""
    found = []
    for level in range(BAYS):
        for c in range(COLUMNS):
            found.append((node(c, level), node(c, level + 1), level))
        for c in range(COLUMNS - 1):
            found.append((node(c, level + 1), node(c + 1, level + 1), level))
            found.append((node(c, level), node(c + 1, level + 1), level))
            found.append((node(c + 1, level), node(c, level + 1), level))
    return found


def truss(name: str, members: list[tuple[int, int, int]], clamped: bool) -> FEModel:
    ids = np.unique([end for a, b, _ in members for end in (a, b)])
    xyz = np.array([[BAY * ((i - 1) % COLUMNS), BAY * ((i - 1) // COLUMNS), 0.0] for i in ids])
    at = {int(i): k for k, i in enumerate(ids)}
    n = 2 * ids.size
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for a, b, _ in members:
        line = (xyz[at[b]] - xyz[at[a]])[:2]
        length = np.hypot(*line)
        c = np.concatenate([-line, line]) / length
        dofs = [2 * at[a], 2 * at[a] + 1, 2 * at[b], 2 * at[b] + 1]
        K[np.ix_(dofs, dofs)] += E * A / length * np.outer(c, c)
        M[np.ix_(dofs, dofs)] += RHO * A * length / 6 * np.kron([[2, 1], [1, 2]], np.eye(2))
    free = np.repeat(ids > COLUMNS, 2) if clamped else np.ones(n, dtype=bool)
    cut = np.array([node(c, CUT) for c in range(COLUMNS)])
    here = {}
    if np.isin(cut, ids).all():
        here["cut"] = Interface("cut", cut, ((1, 2),) * COLUMNS, xyz[[at[int(i)] for i in cut]], np.eye(3))
    table = DofTable(np.repeat(ids, 2)[free], np.tile([1, 2], ids.size)[free])
    return FEModel(
        name,
        sp.csc_array(K[np.ix_(free, free)]),
        sp.csc_array(M[np.ix_(free, free)]),
        table,
        Nodes.in_basic(ids, xyz),
        here,
        grounded=clamped,
    )


def test_whole_truss():
    body = truss("truss", rods(), clamped=True)
    assert (len(rods()), body.n) == (143, 88)
    w = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True))
    np.testing.assert_allclose(w[:6], OMEGA, rtol=4e-5)
    assert w[-1] == pytest.approx(HIGHEST, rel=1e-5)


@pytest.mark.parametrize("reduced", [False, True], ids=["unreduced", "all fixed-interface modes"])
def test_cut_truss(reduced):
    lower = truss("lower", [rod for rod in rods() if rod[2] < CUT], clamped=True)
    upper = truss("upper", [rod for rod in rods() if rod[2] >= CUT], clamped=False)
    assert upper.n == 2 * COLUMNS * (BAYS - CUT + 1)
    joint = Joint("cut", Point("lower", "cut"), Point("upper", "cut"))
    scene = Scene(("lower", "upper"), (0.0, 400.0), (joint,))
    subs = {}
    for body, rigid in ((lower, 0), (upper, 3)):
        R = rigid_body_shapes(body.dofs, body.nodes)
        Phi_r = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
        assert Phi_r.shape[1] == rigid
        if reduced:
            component = orthogonalise(CraigBampton(1e4).reduce(body, body.interface_rows("cut")))
            assert component.rigid_count == rigid
            subs[body.name] = modal_substructure(component, ["cut"])
        else:
            subs[body.name] = physical_substructure(body, ["cut"], Phi_r)
    system = assemble(subs, scene, Configuration("as built"))
    w, _ = system_modes(system, 2e4)
    assert w.size == system.N == 88
    np.testing.assert_allclose(w[:6], OMEGA, rtol=4e-5)
    assert w[-1] == pytest.approx(HIGHEST, rel=1e-5)


def test_the_sample_has_the_frequencies_of_the_whole_truss(tmp_path: Path) -> None:
    """Both parts from their files: joined without reduction, and with the modes that the run keeps."""
    run = Run(load_pipeline(SAMPLE), tmp_path, Silent())
    result = execute(run, SAMPLE, report=False)
    assert result is not None and result.passed
    (as_built,) = run.scene.configurations
    np.testing.assert_allclose(run.comparison.reference.assembled.every_mode(as_built)[0][:6], OMEGA, rtol=4e-5)
    assert run.comparison.reference.assembled.every_mode(as_built)[0][-1] == pytest.approx(HIGHEST, rel=1e-5)
    assert {name: body.rigid.shape[1] for name, body in run.bodies.items()} == {"lower": 0, "upper": 3}
    np.testing.assert_allclose(run.model.assembled.resonances(as_built).omega[:6], OMEGA, rtol=2e-3)


def test_the_sample_is_what_its_script_makes(tmp_path: Path) -> None:
    assert_made_again(SAMPLE.parents[1] / "sample_models" / "truss", tmp_path)
