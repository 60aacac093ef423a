"""A component file seen from another frame, against the file that is written in that frame from the body itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import floating_frame, lumped_mass
from cmsreduce.model import FEModel, FrameCondition, IntegralFrame, Lumping
from cmsreduce.write import ComponentFile, read_component, write_component
from cmsreduce.write.component import flexible_body, in_frame, stored_integrals, with_unit_modal_mass
from tests.consumers.bodies import modes
from tests.mechanics.test_floating_frame import bare, bent, solid

MEAN, CLAMPED = FrameCondition("mean-axis"), FrameCondition("clamped", "root")


def written(
    folder: Path, body: FEModel, condition: FrameCondition | None = None, lumping: Lumping = "consistent"
) -> ComponentFile:
    """Component file of all modes of a body, in a frame that is found from its matrices."""
    component = modes(body)
    frame = None if condition is None else floating_frame(body, component.Phi, 6, condition, lumping)
    about = IntegralFrame.basic(lumping) if frame is None else IntegralFrame("frame", frame.origin, frame.axes, lumping)
    m, path = component.omega.size, folder / f"{condition}.h5"
    row = np.sin(np.arange(m))
    write_component(
        path,
        component,
        nodes=(),
        inputs={"motor": row},
        outputs={"gyro": (row, 2 * row)},
        checks=(),
        provenance={},
        all_nodes=True,
        frame=frame,
        about=about,
    )
    return read_component(path)


def assert_same(found: ComponentFile, expected: ComponentFile, skipped: tuple[str, ...] = ()) -> None:
    for name, value in expected.arrays.items():
        if not name.startswith(("seal", "frame/removed", "frame/node", "frame/component", *skipped)):
            scale = max(1.0, np.nanmax(abs(value), initial=0.0))
            np.testing.assert_allclose(found.arrays[name], value, rtol=0, atol=1e-9 * scale, err_msg=name)


@pytest.mark.parametrize("condition", [MEAN, CLAMPED], ids=str)
@pytest.mark.parametrize("lumping", ["consistent", "row-sum"])
def test_a_solid_in_another_frame_is_the_file_written_in_it(
    tmp_path: Path, condition: FrameCondition, lumping: Lumping
) -> None:
    """Nodes without rotations: every dataset, the integrals of second order too."""
    expected = written(tmp_path, solid(), condition, lumping)
    assert_same(in_frame(written(tmp_path, solid(), None, lumping), condition), expected)


@pytest.mark.parametrize("condition", [MEAN, CLAMPED], ids=str)
@pytest.mark.parametrize("body", [bent, bare], ids=["beams", "static modes"])
def test_beams_in_another_frame(tmp_path: Path, body, condition: FrameCondition) -> None:
    """Displacement frames at every node. The entries of int phi_i phi_j dm of beams are means of two interpolations."""
    plain, expected = written(tmp_path, body()), written(tmp_path, body(), condition)
    found = in_frame(plain, condition)
    assert_same(found, expected, ("integrals/phi_phi",))
    value = expected.arrays["integrals/phi_phi"]
    np.testing.assert_allclose(found.arrays["integrals/phi_phi"], value, rtol=0, atol=1e-4 * abs(value).max())
    trace = np.einsum("iiab->ab", found.arrays["integrals/phi_phi"])
    np.testing.assert_allclose(trace, found.arrays["modes/mass"][6:, 6:], atol=1e-10)
    assert found.attributes["frame"]["kind"] == condition.kind


def test_frames_lead_back_to_each_other(tmp_path: Path) -> None:
    """From clamped to mean axes: the free body's modes and frequencies again."""
    plain = written(tmp_path, bent())
    clamped = with_unit_modal_mass(in_frame(plain, CLAMPED))
    back = with_unit_modal_mass(in_frame(clamped, MEAN))
    np.testing.assert_allclose(back.omega, plain.omega, rtol=1e-8, atol=1e-6)
    first = in_frame(plain, MEAN).arrays
    for name in ("nodes/translation", "nodes/rotation", "interfaces/tip/shapes"):
        np.testing.assert_allclose(abs(back.arrays[name][..., 6:]), abs(first[name][..., 6:]), atol=1e-7)
    for name in ("modes/damping", "inputs/B"):
        np.testing.assert_allclose(abs(back.arrays[name][6:]), abs(first[name][6:]), atol=1e-6)


def test_modes_of_unit_mass_are_vibrations_of_the_held_body(tmp_path: Path) -> None:
    body = bent()
    found = with_unit_modal_mass(in_frame(written(tmp_path, body), CLAMPED))
    free = np.setdiff1d(np.arange(body.n), body.interface_rows("root"))
    K, M = (A.toarray()[np.ix_(free, free)] for A in (body.K, body.M))
    held = np.sqrt(la.eigh(K, M, eigvals_only=True))
    np.testing.assert_allclose(found.omega[6:], held, rtol=1e-7)
    np.testing.assert_array_equal(found.arrays["modes/mass"][6:, 6:], np.eye(held.size))
    # The same mass in its integrals, which every target checks.
    np.testing.assert_allclose(flexible_body(found, stored_integrals(found)).mass, np.eye(held.size), atol=1e-9)


def test_a_lumped_mass_has_its_own_modes_of_unit_mass(tmp_path: Path) -> None:
    body = solid()
    found = with_unit_modal_mass(in_frame(written(tmp_path, body, None, "diagonal"), MEAN))
    M = lumped_mass(body, "diagonal").toarray()
    np.testing.assert_allclose(found.omega[6:], np.sqrt(la.eigh(body.K.toarray(), M, eigvals_only=True)[6:]), rtol=1e-6)


def test_what_cannot_be_seen_from_a_frame_is_refused(tmp_path: Path) -> None:
    plain = written(tmp_path, bent())
    with pytest.raises(WriteError, match="needs six rigid motions, and this body has 0: it is held to the ground"):
        in_frame(replace(plain, rigid_count=0), MEAN)
    with pytest.raises(WriteError, match=r"has no interface 'hub' for its frame \(it has: root, tip\)"):
        in_frame(plain, FrameCondition("clamped", "hub"))
    points = {**plain.arrays, "interfaces/root/component": np.arange(1, 4, dtype=np.int8)}
    points |= {f"interfaces/root/{name}": plain.arrays[f"interfaces/root/{name}"][:3] for name in ("node", "shapes")}
    with pytest.raises(WriteError, match="clamped at root determines 3 of six rigid motions"):
        in_frame(replace(plain, arrays=points), CLAMPED)
    with pytest.raises(WriteError, match=r"static modes have no mass, so they have no unit modal mass"):
        with_unit_modal_mass(written(tmp_path, bare()))
