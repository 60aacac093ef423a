"""Three and five disks on a shaft, cut in two bodies and joined again (Bernard; theory section 6)."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import assemble, modal_substructure, physical_substructure, system_modes
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import Configuration, DofTable, FEModel, Interface, Joint, Point, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton

THREE = ([4, 0.5], [[2, -1], [-1, 1]], [0.5, 1], [[1, -1], [-1, 2]], [0.2803442, 1.1694398, 3.0502160])
FIVE = (
    [4, 1, 0.5],
    [[2, -1, 0], [-1, 2, -1], [0, -1, 1]],
    [0.5, 1, 1],
    [[1, -1, 0], [-1, 2, -1], [0, -1, 2]],
    [0.1933442, 0.5466260, 1.4695587, 2.6608796, 3.6295916],
)


def shaft(name: str, mass: list[float], K: list[list[float]], end: int) -> FEModel:
    n = len(mass)
    face = Interface("cut", np.array([end]), ((0,),), np.zeros((1, 3)), np.eye(3))
    dofs = DofTable(np.arange(1, n + 1), np.zeros(n))
    return FEModel(name, sp.csc_array(K), sp.diags_array(mass, format="csc"), dofs, None, {"cut": face}, grounded=True)


@pytest.mark.parametrize("case", [THREE, FIVE], ids=["three disks", "five disks"])
@pytest.mark.parametrize("reduced", [False, True], ids=["unreduced", "all fixed-interface modes"])
def test_the_whole_shaft_comes_back(case, reduced):
    m1, K1, m2, K2, squares = case
    bodies = {"one": shaft("one", m1, K1, len(m1)), "two": shaft("two", m2, K2, 1)}
    scene = Scene(("one", "two"), (0.0, 1.0), (Joint("weld", Point("one", "cut"), Point("two", "cut")),))
    subs = {}
    for name, body in bodies.items():
        if reduced:
            component = orthogonalise(CraigBampton(10.0).reduce(body, body.interface_rows("cut")))
            subs[name] = modal_substructure(component, ["cut"])
        else:
            rigid = rigid_body_modes(body.K, body.M, None, body.rounding, name)
            assert rigid.shape[1] == 0
            subs[name] = physical_substructure(body, ["cut"], rigid)
    system = assemble(subs, scene, Configuration("as built"))
    w, _ = system_modes(system, 10.0)
    np.testing.assert_allclose(w**2, squares, atol=6e-8)
    assert system.rigid.shape[1] == 0
