"""The reader of EMBS_ModelicaLib, compiled from its sources, on files that the profile `embs` writes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.mechanics import floating_frame
from cmsreduce.model import FloatingFrame, FrameCondition, IntegralFrame
from cmsreduce.write import profile_files, write_component
from cmsreduce.write.component import flexible_body, stored_integrals
from tests.consumers.bodies import modes
from tests.mechanics.test_floating_frame import bent

SOURCES = os.environ.get("CMSREDUCE_EMBS", "")
"""Folder of the sources, with EMBSlib/Resources/Include/ReadSID_C.h."""

pytestmark = [
    pytest.mark.skipif(not SOURCES, reason="CMSREDUCE_EMBS names no folder with the sources of EMBS_ModelicaLib"),
    pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler"),
]
MAIN = """\
#include <stdarg.h>
#include "ReadSID_C.h"
void ModelicaFormatMessage(const char* format, ...) { (void)format; }
"""
Reader = Callable[[Path], "File"]


class File:
    """A file as the reader holds it."""

    def __init__(self, library: ctypes.CDLL, path: Path) -> None:
        self.library = library
        library.SIDFileConstructor_C.restype, library.getMass.restype = ctypes.c_void_p, ctypes.c_double
        self.sid = ctypes.c_void_p(library.SIDFileConstructor_C(str(path).encode()))
        self.mass = library.getMass(self.sid)

    def get(self, name: str, *shape: int, node: int = 0) -> np.ndarray:
        """M0 (rows, columns) or M1 (mode, rows, columns) of a term of the body, or of the node of that number."""
        order = len(shape) - 2
        found = np.full(shape, np.nan)
        # The reader is asked for rows, modes, columns, and gives the modes first.
        asked = [ctypes.c_size_t(n) for n in (shape if order == 0 else (shape[1], shape[0], shape[2]))]
        function = getattr(self.library, f"getM{order}{'Node' if node else ''}")
        into = found.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        function(self.sid, name.encode(), *([ctypes.c_int(node)] if node else []), into, *asked)
        return found


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Reader:
    """The reader, compiled."""
    folder = tmp_path_factory.mktemp("embs")
    (folder / "reader.c").write_text(MAIN)
    (include,) = {path.parent for path in Path(SOURCES).rglob("ReadSID_C.h")}
    command = ["cc", "-std=gnu89", "-w", "-shared", "-fPIC", f"-I{include}", "reader.c", "-o", "reader.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "reader.so"))
    return lambda path: File(library, path)


@pytest.mark.parametrize("name", ["arm", "Jframe 2", "Jrotor", "subframe", "Metal deck"])
@pytest.mark.parametrize("frame", ["mean axes", "clamped"])
def test_every_array_reaches_the_reader(
    reader: Reader, tmp_path: Path, name: str, frame: str, record_property: Callable[[str, object], None]
) -> None:
    component = replace(modes(bent()), body=replace(bent(), name=name))
    condition = FrameCondition("clamped", "root") if frame == "clamped" else FrameCondition("mean-axis")
    place: FloatingFrame = floating_frame(component.body, component.Phi, 6, condition)
    write_component(
        tmp_path / "body.h5",
        component,
        nodes=(),
        inputs={},
        outputs={},
        checks=(),
        provenance={},
        all_nodes=True,
        frame=place,
        about=IntegralFrame("frame", place.origin, place.axes),
    )
    made = profile_files(tmp_path / "body.h5", "embs", tmp_path)
    sid = reader(made.paths[0])
    body = flexible_body(made.body, stored_integrals(made.body))
    terms, k = body.integrals, body.k
    x, J = terms.first_moment, terms.inertia
    np.testing.assert_allclose(body.mass, np.eye(k), atol=1e-10)
    coupling = 2 * (np.einsum("iil,ab->abl", terms.r_phi, np.eye(3)) - np.swapaxes(terms.r_phi, 0, 1))
    growth = 2 * np.einsum("iil,ab->abl", terms.r_phi, np.eye(3)) - terms.r_phi - np.swapaxes(terms.r_phi, 0, 1)
    turning = np.moveaxis(body.phi_cross_phi, (0, 1, 2), (2, 1, 0))  # [mode, other mode, axis]
    J_rows, Oe_columns = (
        [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)],
        [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)],
    )
    Oe = np.array([-0.5 * growth[a, b] * (1 if a == b else 2) for a, b in Oe_columns]).T
    # [axis, mode] columns in blocks of three a mode, as its equations take them.
    expected = {
        ("mdCM", (3, 1)): x[:, None],
        ("mdCM", (k, 3, 1)): terms.phi.T[:, :, None],
        ("J", (6, 1)): np.array([[J[a, b]] for a, b in J_rows]),
        ("J", (k, 6, 1)): np.array([[[growth[a, b, mode]] for a, b in J_rows] for mode in range(k)]),
        ("Ct", (k, 3)): terms.phi.T,
        ("Cr", (k, 3)): terms.r_cross_phi.T,
        ("Cr", (k, k, 3)): np.moveaxis(turning, 1, 0),
        ("Me", (k, k)): np.eye(k),
        ("Gr", (3, 3 * k)): np.hstack([coupling[:, :, mode] for mode in range(k)]),
        ("Ge", (k, 3 * k)): np.hstack([2 * turning[:, mode] for mode in range(k)]),
        ("Oe", (k, 6)): Oe,
        ("ksigma", (k, 1)): np.zeros((k, 1)),
        ("Ke", (k, k)): body.stiffness,
        ("De", (k, k)): body.damping,
    }
    assert made.paths[0].name == f"{name}.SID_FEM"
    assert sid.mass == pytest.approx(terms.mass, rel=1e-14)
    for (term, shape), values in expected.items():
        error = abs(sid.get(term, *shape) - values).max() / max(abs(values).max(), 1e-12)
        record_property("error", float(error))
        assert error <= 1e-12, term
    for at in range(body.node.size):
        places = {"origin": body.position[at][:, None], "phi": body.translation[at], "psi": body.rotation[at]}
        for term, values in places.items():
            found = sid.get(term, *values.shape, node=at + 1)
            np.testing.assert_allclose(found, values, rtol=0, atol=1e-12 * abs(values).max(initial=1.0))
    if frame == "clamped":
        # Its equations take the unit matrix as modal mass: then its frequencies are those of the file.
        assert made.body.omega[6] < 0.7 * component.omega[6]
        np.testing.assert_allclose(np.sqrt(np.diagonal(sid.get("Ke", k, k))), made.body.omega[6:], rtol=1e-12)
