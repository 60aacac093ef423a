"""A bar whose end face CalculiX makes rigid, with a lump on an arm: our tie of its matrices has its frequencies."""

from pathlib import Path

import numpy as np
import pytest

from tests.golden.test_calculix import CELLS, SIDES, deck, files, opened, section, solve

pytestmark = pytest.mark.ccx

REFERENCE, TURN = 90001, 90002
AT, LUMP = (SIDES[0] + 0.2, 0.1, 0.05), 30.0


def rigid_end(element: str) -> str:
    """End face on a reference node, which carries a point mass."""
    nodes = ",\n".join(str(n) for n in section(CELLS[0], element))
    return (
        f"*NODE, NSET=REF\n{REFERENCE}, {AT[0]}, {AT[1]}, {AT[2]}\n{TURN}, {AT[0]}, {AT[1]}, {AT[2]}\n"
        f"*NSET, NSET=END\n{nodes}\n*RIGID BODY, NSET=END, REF NODE={REFERENCE}, ROT NODE={TURN}\n"
        f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n99999, {REFERENCE}\n*MASS, ELSET=LUMP\n{LUMP}\n"
    )


@pytest.mark.parametrize("clamped", [False, True], ids=["free", "clamped"])
def test_a_rigid_end_with_a_lump(tmp_path: Path, clamped: bool) -> None:
    hertz = solve(tmp_path, "tied", deck(0, CELLS[0], clamped) + rigid_end("C3D8"), matrices=False, modes=20)
    solve(tmp_path, "bar", deck(0, CELLS[0], clamped), matrices=True)
    tie = f"{{nodes: {section(CELLS[0], 'C3D8')}, tie: rigid, position: {list(AT)}}}"
    bodies = {
        "bar": f"{{{files('bar')}, grounded: {str(clamped).lower()}, interfaces: {{end: {tie}}}}}",
        "lump": f"{{rigid: {{mass: {LUMP}, cg: {list(AT)}, inertia: [0, 0, 0, 0, 0, 0]}}, "
        f"interfaces: {{point: {{position: {list(AT)}}}}}}}",
    }
    run = opened(tmp_path, bodies, "{weld: {connect: [bar.end, lump.point]}}", "cutoff: 10")
    (configuration,) = run.scene.configurations
    model = run.comparison.reference.assembled
    r = 0 if clamped else 6
    assert model.system(configuration).rigid.shape[1] == r
    found = model.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(found[:12], hertz[r : r + 12], rtol=1e-6)
