"""Bodies written for SID and MBDyn come back with all that the format holds, also the integrals of second order."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import ReadError
from cmsreduce.mechanics import modal_integrals
from cmsreduce.model import SI, Units, in_units, rigid_body_shapes
from cmsreduce.read import InterfaceSpec, in_dofs, read_mbdyn, read_sid
from cmsreduce.write.targets.mbdyn import write_mbdyn
from cmsreduce.write.targets.sid import write_sid
from tests.write.particles import FORMATS, particles

FILES = [
    *((write_sid, read_sid, dialect) for dialect in ("by-axis", "by-mode", "gr-by-mode", "embs")),
    *((write_mbdyn, read_mbdyn, dialect) for dialect in ("points", "invariants", "lumped")),
]


@pytest.fixture(params=FILES, ids=lambda row: f"{row[1].__name__}-{row[2]}")
def read_again(request, tmp_path):
    """Particles, lumps for the dialect that has no others, and the body of their file."""
    write, read, dialect = request.param
    # Lumps of MBDyn have inertia about its axes alone, so that lumps without any are the same body.
    written = particles(0.0 if dialect == "lumped" else 0.3)
    write(tmp_path / "body", written.file, written.integrals, dialect)
    return written, read("body", tmp_path / "body", SI)


def assert_close(found, expected, digits=1e-9):
    np.testing.assert_allclose(found, expected, rtol=0, atol=digits * abs(expected).max())


def test_matrices_and_integrals_come_back(read_again):
    written, modal = read_again
    integrals = written.integrals
    assert_close(modal.K[6:, 6:], written.file.arrays["modes/stiffness"])
    assert_close(modal.D[6:, 6:], written.file.arrays["modes/damping"])
    assert_close(modal.M[6:, 6:], np.eye(4))
    assert_close(modal.M[:3, 6:], integrals.phi)
    assert_close(modal.M[3:6, 6:], integrals.r_cross_phi)
    assert_close(modal.M[3:6, 3:6], integrals.inertia)
    assert_close(modal.second_order.r_phi[..., 6:], integrals.r_phi)
    assert_close(modal.second_order.phi_phi[..., 6:, 6:], integrals.phi_phi)
    # Rigid motions are shapes as well.
    assert_close(np.einsum("iiab->ab", modal.second_order.phi_phi), modal.M)


@pytest.mark.parametrize("units", ["m-kg-s", "mm-t-s"])
def test_body_at_its_interface_has_the_integrals_of_the_particles(read_again, units):
    written, modal = read_again
    body = in_units(in_dofs(modal, {"tip": InterfaceSpec((34,))}), Units.parse(units))
    lam, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    expected_lam, amplitudes = la.eigh(modal.K, modal.M)
    time = body.units.time
    np.testing.assert_allclose(np.sqrt(lam[6:]), np.sqrt(expected_lam[6:]) * time, rtol=1e-8)
    mass, length = body.units.mass, body.units.length
    R = rigid_body_shapes(body.dofs, body.nodes)
    scale = np.repeat([1.0, length], 3)
    assert_close(R.T @ body.M @ R, modal.M[:6, :6] / np.outer(scale, scale) / mass, 1e-8)
    # Particles move as the modes and the rigid motion of the frame.
    origin, m, x = np.array([0.1, -0.4, 0.2]), written.m, written.x
    found = modal_integrals(body, Phi[:, 6:], origin=origin / length)
    turned = np.cross(amplitudes[3:6, 6:].T[None], x[:, None]).transpose(0, 2, 1)
    u = amplitudes[:3, 6:] + turned + written.u @ amplitudes[6:, 6:]
    r_phi = np.einsum("p,pi,pja->ija", m, x - origin, u) / (np.sqrt(mass) * length)
    signs = np.sign(np.einsum("ija,ija->a", found.r_phi, r_phi))
    assert_close(found.r_phi * signs, r_phi, 1e-7)
    assert_close(found.phi_phi * np.outer(signs, signs), np.einsum("p,pia,pjb->ijab", m, u, u), 1e-7)


def test_body_of_another_program():
    """A steel bar of 30 x 20 x 1000 mm in 21 lumps, held at its root, that MBDyn 1.7.3 runs: set free, it is free."""
    path = FORMATS / "mbdyn_beam.fem"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    modal = read_mbdyn("beam", path, SI)
    body = in_dofs(modal, {"root": InterfaceSpec((1001,)), "tip": InterfaceSpec((1021,))})
    assert modal.M[0, 0] == pytest.approx(7850 * 0.03 * 0.02)
    # Bending about both axes; half of a lump too much at either end lowers them by 0.8 %.
    root = np.sqrt(2.1e11 / 7850 / 12)
    expected = 4.730041**2 / (2 * np.pi) * root * np.array([0.02, 0.03])
    hz = np.sqrt(la.eigvalsh(body.K.toarray(), body.M.toarray())[6:8]) / (2 * np.pi)
    np.testing.assert_allclose(hz, expected, rtol=0.01)
    assert (hz < expected).all()
    assert_close(np.einsum("iiab->ab", modal.second_order.phi_phi), modal.M)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("GROUP 9,", "GROUP 99,", r"record group 9 \(modal mass\) is missing"),
        ("** RECORD GROUP 10", "1.0\n** RECORD GROUP 10", "record group 9 has 17 numbers, where 16 fit 7 nodes and 4"),
        ("** RECORD GROUP 12", "** RECORD 12", "it states no mass"),
        ("E+0", "X+0", "could not convert"),
    ],
)
def test_damaged_files_name_what_is_wrong(tmp_path, old, new, words):
    written, path = particles(), tmp_path / "body.fem"
    write_mbdyn(path, written.file, written.integrals, "invariants")
    text = path.read_text().replace("e+0", "E+0")
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ReadError, match=rf"body\.fem: .*{words}"):
        read_mbdyn("body", path, SI)


@pytest.mark.parametrize("term", ["Gr", "Ge", "Oe"])
def test_terms_that_contradict_each_other_leave_a_body_for_slow_rotations(tmp_path, term):
    """Terms of other modes, or with geometric stiffness in them: the linear body is whole all the same."""
    written, path = particles(), tmp_path / "body.sid"
    write_sid(path, written.file, written.integrals, "by-mode")
    lines, inside = [], False
    for number, line in enumerate(path.read_text().splitlines()):
        inside = (inside or line.split() == [term]) and line.split() != ["end", term]
        # Other numbers in every line, so that no factor explains them.
        changed = f"{1 + number % 7}." if inside and " m" in line else line[48:]
        lines.append(f"{line[:48]}={changed.lstrip('=')}" if "=" in line else line)
    path.write_text("\n".join(lines) + "\n")
    modal = read_sid("body", path, SI)
    assert modal.second_order is None
    (remark,) = modal.remarks
    assert "read for slow rotations" in remark and f"{term}" in remark
    assert_close(modal.M[3:6, 6:], written.integrals.r_cross_phi)
