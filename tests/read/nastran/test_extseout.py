"""External superelements: order, sets and frames, against pyYeti's reader and by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.superelements import read_extseout

GRIDS = ["GRID,3,,1.,2.,3.", "GRID,11,,4.,5.,6.,10", "SPOINT,901,902"]
FRAME = ["CORD2R,10,0,0.,0.,0.,1.,0.,0.", "+,0.,1.,0."]


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_extrn_tells_order_and_components(tmp_path: Path) -> None:
    lines = ["BEGIN SUPER 5", *FRAME, "EXTRN,11,246,3,1,901,THRU,902,0", *GRIDS]
    found = read_extseout(write(tmp_path / "a.pch", lines))
    assert found.rows["a"].labels == ["11.2", "11.4", "11.6", "3.1", "901.0", "902.0"]
    assert found.sets["b"].labels == ["11.2", "11.4", "11.6", "3.1"]
    assert found.sets["q"].labels == ["901.0", "902.0"]
    np.testing.assert_allclose(found.nodes.frame[1], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)


def test_an_assembly_file_alone_has_six_dofs_a_grid(tmp_path: Path) -> None:
    lines = ["SECONCT,5,0,,NO", "+,11,11,3,3,901,THRU,902", "+,901,THRU,902", *FRAME, *GRIDS]
    found = read_extseout(write(tmp_path / "a.asm", lines))
    assert found.rows["a"].labels == [f"{n}.{c}" for n in (11, 3) for c in range(1, 7)] + ["901.0", "902.0"]


def test_the_punch_file_beside_an_assembly_file_is_asked_first(tmp_path: Path) -> None:
    write(tmp_path / "a.pch", ["BEGIN SUPER 5", *FRAME, "EXTRN,3,12,901,0", *GRIDS])
    found = read_extseout(write(tmp_path / "a.asm", ["SECONCT,5,0,,NO", "+,3,3,901,901", *FRAME, *GRIDS]))
    assert found.rows["a"].labels == ["3.1", "3.2", "901.0"]
    assert [path.name for path in found.files] == ["a.asm", "a.pch"]


def test_grids_renumbered_in_the_assembly_go_by_the_superelement_s_own_ids(tmp_path: Path) -> None:
    found = read_extseout(
        write(tmp_path / "a.asm", ["SECONCT,5,0,,NO", "+,7003,3,7901,901", "GRID,3,,1.,2.,3.", "SPOINT,901"])
    )
    assert found.rows["a"].labels == [f"7003.{c}" for c in range(1, 7)] + ["7901.0"]
    assert found.nodes.id.tolist() == [7003]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["SECONCT,5,0", "+,3,3", "SECONCT,6,0", "+,11,11", *FRAME, *GRIDS], "holds several superelements"),
        (["SECONCT,5,0", "+,3,3,11", *FRAME, *GRIDS], "do not come in pairs"),
        (["SECONCT,5,0", "+,3,3,12,12", *FRAME, *GRIDS], "names 12, but there is no such GRID or SPOINT"),
        (["EXTRN,3,12,11", *FRAME, *GRIDS], "no components follow 11"),
        (["EXTRN,3,12,12,1", *FRAME, *GRIDS], "names node 12"),
        (GRIDS[:1], "no external superelement"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_extseout(write(tmp_path / "a.asm", lines))


@pytest.mark.shared
@pytest.mark.parametrize(("name", "q"), [("inboard", 8), ("outboard", 22)])
def test_real_superelements_are_as_pyyeti_reads_them(shared_data: Path, name: str, q: int) -> None:
    from pyyeti.nastran import bulk

    path = shared_data / "nas2cam" / f"{name}.asm"
    uset, frames, boundary = bulk.asm2uset(str(path))
    found = read_extseout(path)
    ids = uset.index.get_level_values("id").to_numpy()
    components = uset.index.get_level_values("dof").to_numpy()
    assert found.rows["a"].node.tolist() == ids.tolist()
    assert found.rows["a"].component.tolist() == components.tolist()
    assert len(found.sets["b"]) == boundary.sum() == 24
    assert len(found.sets["q"]) == q
    # Its axes are columns, ours are rows.
    np.testing.assert_allclose(found.nodes.frame[found.nodes.index(11)[0]], frames[10][2:].T, atol=1e-15)
    np.testing.assert_allclose(found.nodes.xyz[found.nodes.index(11)[0]], [600, 300, 300])
    np.testing.assert_allclose(found.nodes.frame[found.nodes.index(27)[0]], np.eye(3))
