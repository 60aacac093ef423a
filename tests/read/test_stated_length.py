"""Units of length that geometry files state, against the units in which a body is read."""

from __future__ import annotations

from pathlib import Path

import pytest
import scipy.io
import scipy.sparse as sp

from cmsreduce.model import SI, Units
from cmsreduce.read import MatrixSource, read_body
from cmsreduce.read.file_kind import geometry_format
from tests.frames import line

UNIVERSAL = "    -1\n   164\n{}\n    -1\n    -1\n  2411\n"
ARCHIVE = "/COM,ANSYS RELEASE 2023 R2\n/PREP7\n{}\nNBLOCK,6,SOLID,8,8\n(3i9,6e21.13e3)\n"
LISTING = "Node Number\tX Location {0}\tY Location {0}\tZ Location {0}\n1\t0.0\t0.0\t0.0\n"


@pytest.mark.parametrize(
    ("head", "metres"),
    [
        (UNIVERSAL.format("         5MM : mm (newton)          2\n 1.0D+03 1.0D+00 1.0D+00\n 273.15D+00"), 1e-3),
        (UNIVERSAL.format("         1SI: Meter (newton)         2\n    1.0000000000000000E+00 1.0 1.0\n 273.15"), 1.0),
        (
            UNIVERSAL.format("         7IN: Inch (pound f)         2\r\n  3.9370079D+01  2.2480894D-01 1.0\r\n 0."),
            0.0254,
        ),
        # Numbers of full width leave no blank between them.
        (UNIVERSAL.format("         5MM\n" + "1.0000000000000000000D+03" * 3 + "\n 273.15"), 1e-3),
        (UNIVERSAL.format("         9US\n 0.0 0.0 0.0"), None),
        (ARCHIVE.format("/UNITS,MPA,0.0,0.0"), 1e-3),
        (ARCHIVE.format("/units, bin"), 0.0254),
        (ARCHIVE.format("/UNITS,USER,1.0"), None),
        (ARCHIVE.format("!/UNITS"), None),
        (LISTING.format("(mm)"), 1e-3),
        (LISTING.format(""), None),
    ],
)
def test_the_unit_of_length_of_a_file(head: str, metres: float | None) -> None:
    format = geometry_format(head.encode())
    assert format is not None
    found = format.length(head.replace("\r", ""))
    assert (found is None) == (metres is None)
    if found is not None:
        assert found.metres == pytest.approx(metres, rel=1e-6)


@pytest.mark.parametrize(("stated", "units", "said"), [("(mm)", SI, "mm"), ("(m)", Units.parse("mm-t-s"), "m")])
def test_a_file_in_another_unit_than_the_keys(tmp_path: Path, stated: str, units: Units, said: str) -> None:
    """Solids have no rotations, and so no forces that tell metres from millimetres."""
    body = line("bar", [0, 0, 0], [1, 0.5, 0.2], 3)
    assert body.nodes is not None
    for name, A in (("K", body.K), ("M", body.M)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sp.coo_array(A), precision=17)
    rows = [
        "\t".join([str(id), *map(repr, xyz)]) for id, xyz in zip(body.nodes.id, body.nodes.xyz.tolist(), strict=True)
    ]
    K, M = (MatrixSource(tmp_path / f"{name}.mtx") for name in "KM")

    def remarks(heading: str, units: Units) -> tuple[str, ...]:
        (tmp_path / "nodes.txt").write_text("\n".join([LISTING.format(heading).splitlines()[0], *rows]) + "\n")
        return read_body("bar", stiffness=K, mass=M, geometry=tmp_path / "nodes.txt", units=units).remarks

    (remark,) = remarks(stated, units)
    assert f"states coordinates in {said} (" in remark and f"read in {units.name}" in remark
    assert remarks(f"({units.length_name})", units) == () == remarks("", units)
