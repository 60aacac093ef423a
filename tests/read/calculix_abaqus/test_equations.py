"""The equations of a CalculiX or Abaqus deck, for the causes of refusals: what is damaged in them stops nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from cmsreduce.read.calculix_abaqus.constraints import equations


@pytest.mark.parametrize(
    ("lines", "keys", "factors"),
    [
        ("2\n1, 1, 1., 2, 1, -1.", [(1, 1), (2, 1)], [1.0, -1.0]),
        ("3\n1, 1, 1., 2, 1, -2., 1, 1, 0.5", [(1, 1), (2, 1)], [1.5, -2.0]),
        ("1\n7, 3, 1D0", [(7, 3)], [1.0]),
    ],
)
def test_terms_of_one_dof_add_up(tmp_path: Path, lines: str, keys, factors) -> None:
    (tmp_path / "a.inp").write_text(f"*NODE\n1,0.\n2,1.\n7,2.\n*EQUATION\n{lines}\n")
    ((where, dofs, found),) = equations(tmp_path / "a.inp")
    assert list(zip(dofs.node.tolist(), dofs.component.tolist(), strict=True)) == keys and found.tolist() == factors
    assert where.endswith("line 5: *EQUATION")


@pytest.mark.parametrize("component", ["300", "11", "0", "-1", "x", "1.5", ""])
@pytest.mark.parametrize("factor", ["1.", "1e", "x"])
def test_equations_of_no_motion_are_passed_over(tmp_path: Path, component: str, factor: str) -> None:
    """A component of 300 ended in an internal error, and one of a temperature in a message about rows."""
    (tmp_path / "a.inp").write_text(f"*NODE\n1,0.\n2,1.\n*EQUATION\n2\n1, {component}, {factor}, 2, 1, -1.\n")
    assert equations(tmp_path / "a.inp") == []
