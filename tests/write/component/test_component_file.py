"""The component file holds the reduced body, whole, and reads back as its page says."""

import re
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.model import (
    CostlyMode,
    CostlyModes,
    Damping,
    DofTable,
    FEModel,
    Finding,
    GeometricStiffness,
    Interface,
    Nodes,
    ParameterTerm,
    UnitLoad,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import read_component, write_component

PAGE = Path(__file__).parents[3] / "docs" / "component-file.md"
ANGLE = 0.3
TURN = np.array([[np.cos(ANGLE), np.sin(ANGLE), 0], [-np.sin(ANGLE), np.cos(ANGLE), 0], [0, 0, 1]])


def chain(masses=(1.0, 2.0, 3.0), stiffness=50.0):
    """Point masses on a line, joined along x by springs, the last one in a turned frame."""
    n = len(masses)
    axes = np.tile(np.eye(3), (n, 1, 1))
    axes[-1] = TURN
    nodes = Nodes(np.arange(1, n + 1), np.column_stack([np.arange(n), np.zeros((n, 2))]), axes)
    dofs = DofTable(np.repeat(np.arange(1, n + 1), 3), np.tile([1, 2, 3], n))
    K = np.zeros((3 * n, 3 * n))
    for k in range(n - 1):
        spring = stiffness * np.kron([[1, -1], [-1, 1]], np.diag([1.0, 0.5, 0.25]))
        at = slice(3 * k, 3 * k + 6)
        K[at, at] += spring
    Q = np.eye(3 * n)
    Q[-3:, -3:] = TURN
    M = np.diag(np.repeat(masses, 3))
    face = Interface("end", np.array([1]), ((1, 2, 3),), np.zeros((1, 3)), np.eye(3))
    return FEModel("chain", sp.csc_array(Q @ K @ Q.T), sp.csc_array(M), dofs, nodes, {"end": face}, Damping(modal=0.01))


@pytest.fixture
def component():
    body = chain()
    modes = orthogonalise(CraigBampton(1e3).reduce(body, body.interface_rows("end")))
    rankings = {"gregory": np.arange(modes.omega.size) - 1.0, "modal-gain": 2.0 * modes.omega}
    # The spacing of repeated modes, as of a rod that bends two ways.
    return replace(modes, rankings=rankings, spacing=np.full(modes.omega.size, np.inf))


def stressed(body):
    """What the chain's own stiffness would be per unit of a pull."""
    return GeometricStiffness((UnitLoad("force", "x", "3"),), (body.K,), ("by hand",), np.zeros(3), "at end")


def written(path, component, **changes):
    m = component.omega.size
    options = {
        "nodes": [3],
        "inputs": {"push": np.arange(m, dtype=float)},
        "outputs": {"gauge": (np.ones(m), np.zeros(m))},
        "checks": [Finding("orthogonality in M", 1e-15, 1e-8)],
        "provenance": {"settings": {"name": "chain"}, "notes": []},
    }
    write_component(path, component, **(options | changes))
    return path


def test_everything_reads_back_exactly(tmp_path, component):
    file = read_component(written(tmp_path / "chain.h5", component, all_nodes=True))
    body = component.body
    assert (file.name, file.method, file.rigid_count) == ("chain", "craig-bampton", 3)
    np.testing.assert_array_equal(file.omega, component.omega)
    np.testing.assert_array_equal(file.arrays["dofs/shapes"], component.Phi)
    np.testing.assert_array_equal(file.arrays["dofs/node"], body.dofs.node)
    np.testing.assert_array_equal(file.arrays["modes/damping"], np.diag(2 * 0.01 * component.omega))
    np.testing.assert_array_equal(file.arrays["inputs/B"][:, 0], np.arange(component.omega.size))
    assert file.texts["modes/kind"] == component.kind
    assert file.texts["dofs/label"] == tuple(body.dofs.labels)
    assert file.checks == (Finding("orthogonality in M", 1e-15, 1e-8),)
    assert file.settings == {"name": "chain"}


def test_integrals_are_those_of_three_point_masses(tmp_path, component):
    arrays = read_component(written(tmp_path / "chain.h5", component)).arrays
    assert arrays["integrals/mass"] == pytest.approx(6.0, rel=1e-14)
    np.testing.assert_allclose(arrays["integrals/first_moment"], [8.0, 0, 0], atol=1e-13)
    np.testing.assert_allclose(arrays["integrals/inertia"], np.diag([0, 14.0, 14.0]), atol=1e-12)
    # Elastic modes of a free body carry no momentum (theory section 7).
    np.testing.assert_allclose(arrays["integrals/int_phi"][:, 3:], 0, atol=1e-12)


def test_second_order_integrals_are_sums_over_three_point_masses(tmp_path, component):
    arrays = read_component(written(tmp_path / "chain.h5", component)).arrays
    modes = arrays["integrals/modes"]
    np.testing.assert_array_equal(modes, np.arange(3, component.omega.size))
    u = component.Phi[:, modes].reshape(3, 3, -1).copy()
    u[-1] = TURN.T @ u[-1]
    r, m = np.column_stack([np.arange(3.0), np.zeros((3, 2))]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(arrays["integrals/r_phi"], np.einsum("n,ni,njk->ijk", m, r, u), atol=1e-12)
    np.testing.assert_allclose(arrays["integrals/phi_phi"], np.einsum("n,nia,njb->ijab", m, u, u), atol=1e-12)


def test_shapes_of_a_turned_node_are_given_along_basic_axes(tmp_path, component):
    arrays = read_component(written(tmp_path / "chain.h5", component)).arrays
    k = list(arrays["nodes/id"]).index(3)
    np.testing.assert_allclose(arrays["nodes/translation"][k], TURN.T @ component.Phi[-3:], atol=1e-15)
    assert np.isnan(arrays["nodes/rotation"]).all()


def test_motion_is_given_only_where_it_is_known(tmp_path):
    """Node 1 lacks x; node 3, whose frame is turned about z, lacks its own x; node 2 is held in z."""
    body = chain()
    keep = np.array([1, 2, 3, 4, 7, 8])
    held = DofTable(np.array([2]), np.array([3]))
    cut = replace(
        body,
        K=body.K[keep][:, keep],
        M=body.M[keep][:, keep],
        dofs=DofTable(body.dofs.node[keep], body.dofs.component[keep]),
        constrained=held,
        interfaces={},
    )
    component = orthogonalise(CraigBampton(1e3).reduce(cut, []))
    file = read_component(written(tmp_path / "chain.h5", component, nodes=[1, 2, 3]))
    translation, m = file.arrays["nodes/translation"], component.omega.size
    unknown = np.isnan(translation).all(axis=2)
    np.testing.assert_array_equal(unknown, [[True, False, False], [False, False, False], [True, True, False]])
    np.testing.assert_array_equal(translation[1, 2], np.zeros(m))
    np.testing.assert_allclose(translation[2, 2], component.Phi[5], atol=1e-15)
    assert file.attributes[""]["support"].startswith("held")


def test_every_rigid_motion_is_named_in_the_support(tmp_path, component):
    file = read_component(written(tmp_path / "chain.h5", component))
    assert file.attributes[""]["support"] == "floating: the first 3 modes are its rigid motions"


def test_steps_follow_from_the_highest_frequency(tmp_path, component):
    steps = read_component(written(tmp_path / "chain.h5", component)).attributes["integration"]
    # Masses a, b, c on two springs k: a b c w^4 - k (a b + 2 a c + b c) w^2 + k^2 (a + b + c) = 0, with 1, 2, 3 and 50.
    top = np.sqrt(50 * (14 + np.sqrt(14**2 - 4 * 6 * 6)) / 12)
    assert steps["highest_omega"] == pytest.approx(top, rel=1e-13)
    assert steps["central_difference_stable_step"] == pytest.approx(2 / top, rel=1e-13)
    # The trapezoidal rule gives tan(w' h / 2) = w h / 2: 0.346 by the first term of its error.
    x = steps["trapezoidal_step_1_percent"] * top
    assert x == pytest.approx(0.346, rel=0.02) and 2 * np.arctan(x / 2) / x == pytest.approx(0.99, rel=1e-12)
    assert steps["ab2_step_0.1_percent"] * top == pytest.approx(np.sqrt(0.001 * 12 / 5), rel=1e-2)


@pytest.fixture
def bare():
    """The chain with nothing on its first point, which its joint holds: three static modes, one along each axis."""
    body = chain(masses=(0.0, 2.0, 3.0))
    return orthogonalise(CraigBampton(1e3).reduce(replace(body, damping=Damping(rayleigh=(0.0, 1e-3))), [0, 1, 2]))


def test_static_modes_come_last_and_have_no_frequency(tmp_path, bare):
    file = read_component(written(tmp_path / "chain.h5", bare))
    assert (file.rigid_count, file.static_count, file.elastic) == (3, 3, slice(3, 6))
    assert np.isnan(file.omega[6:]).all() and np.isnan(file.arrays["modes/frequency_hz"][6:]).all()
    assert not np.isinf(np.concatenate([array.ravel() for array in file.arrays.values()])).any()
    np.testing.assert_array_equal(file.arrays["modes/mass"], np.diag([1] * 6 + [0] * 3))
    # beta K damps them, and two masses on three springs have w^2 = k (1/2 + 1/3).
    squared = 50 * np.array([0.25, 0.5, 1.0]) * 5 / 6
    np.testing.assert_allclose(file.arrays["modes/stiffness"], np.diag([0, 0, 0, *squared, 1, 1, 1]), atol=1e-11)
    np.testing.assert_allclose(file.arrays["modes/damping"], 1e-3 * file.arrays["modes/stiffness"], atol=1e-14)
    assert file.attributes["integration"]["highest_omega"] == pytest.approx(np.sqrt(squared[-1]), rel=1e-12)
    # The first springs, one after the other in their direction, are all the flexibility that the joint sees besides.
    S = file.arrays["interfaces/end/shapes"][:, 6:]
    np.testing.assert_allclose(S @ S.T, np.diag([1 / 50, 1 / 25, 1 / 12.5]), atol=1e-15)


def test_a_file_of_the_first_version_has_no_static_modes(tmp_path, component):
    path = written(tmp_path / "chain.h5", component)
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 1
        del file["modes"].attrs["static_count"]
        del file.attrs["content_sha256"], file["seal"]
    old = read_component(path)
    assert (old.static_count, old.sealed) == (0, False)


def test_the_lines_on_the_page_read_it(tmp_path, component, monkeypatch):
    written(tmp_path / "rotor.h5", component)
    monkeypatch.chdir(tmp_path)
    found: dict = {}
    exec(re.search(r"```python\n(.*?)```", PAGE.read_text(), re.S)[1], found)
    np.testing.assert_allclose(found["frequencies_hz"], component.omega[3:] / 2 / np.pi, rtol=1e-14)
    assert found["faces"]["end"].shape == (3, component.omega.size)


def test_stress_adds_what_it_is_in_the_modes(tmp_path, component):
    file = read_component(written(tmp_path / "chain.h5", component, stiffening=stressed(component.body)))
    # Of a matrix that is the stiffness itself, the modes see the squares of their frequencies.
    K = file.arrays["geometric_stiffness/K"]
    np.testing.assert_allclose(K, [np.diag(component.stiffness)], atol=1e-9 * component.stiffness.max())
    assert file.texts["geometric_stiffness/load"] == ("force 3.x",)
    assert file.attributes["geometric_stiffness"]["held"] == "at end"
    with h5py.File(tmp_path / "chain.h5", "r+") as raw:
        del raw["geometric_stiffness/K"]
        raw["geometric_stiffness/K"] = K[:, :-1]
    with pytest.raises(ReadError, match="geometric_stiffness/K"):
        read_component(tmp_path / "chain.h5")


def test_every_path_on_the_page_is_in_the_file(tmp_path, component):
    page, _, _ = PAGE.read_text().partition("## system.h5")
    table = [line for line in page.splitlines() if line.startswith("| `")]
    pulled, costly = stressed(component.body), CostlyModes((CostlyMode(4, 9.0, "fixed", 1e-5),), 3.0, 2.0, 1e-3)
    m = component.omega.size
    skew = np.triu(np.ones((m, m)), 1) - np.tril(np.ones((m, m)), -1)
    terms = (ParameterTerm("end", "M", np.eye(m)), ParameterTerm("", "G", skew, 0))
    component = replace(component, terms=terms)
    with h5py.File(written(tmp_path / "chain.h5", component, stiffening=pulled, costly=costly)) as file:
        for line in table:
            folder = ""
            for item in re.findall(r"`([^`]+)`", line.split("|")[1]):
                path = item if "/" in item or not folder else f"{folder}/{item}"
                folder = path.rpartition("/")[0]
                if path not in ("modes/loss",):
                    assert path.replace("NAME/", "end") in file, path


def test_every_ranking_reads_back_and_must_fit_the_modes(tmp_path, component):
    path = written(tmp_path / "chain.h5", component)
    found = read_component(path).rankings
    assert set(found) == {"gregory", "modal-gain"}
    np.testing.assert_array_equal(found["modal-gain"], 2.0 * component.omega)
    with h5py.File(path, "r+") as file:
        del file["modes/rankings/gregory"]
        file["modes/rankings/gregory"] = np.zeros(component.omega.size - 1)
    with pytest.raises(ReadError, match="modes/rankings/gregory"):
        read_component(path)
    assert read_component(written(tmp_path / "bare.h5", replace(component, rankings={}))).rankings == {}


def test_same_input_gives_same_bytes_at_another_time(tmp_path, component):
    def stripped(path):
        with h5py.File(path, "r+") as file:
            file.attrs.modify("created_utc", "2000-01-01T00:00:00+00:00")
        return path.read_bytes()

    first = stripped(written(tmp_path / "a.h5", component))
    # HDF5 stores the time of creation to the second unless this is switched off.
    time.sleep(1.1)
    assert first == stripped(written(tmp_path / "b.h5", component))


def test_the_file_can_be_read_with_swmr_and_every_array_has_a_checksum(tmp_path, component):
    with h5py.File(written(tmp_path / "chain.h5", component, all_nodes=True), "r", swmr=True) as file:
        arrays = []
        file.visititems(lambda _, item: arrays.append(item) if isinstance(item, h5py.Dataset) else None)
        assert len(arrays) > 30
        assert all(item.fletcher32 for item in arrays if item.ndim and item.size)
        assert file["dofs/shapes"].compression == "gzip"


def test_a_changed_byte_is_found(tmp_path, component):
    path = written(tmp_path / "chain.h5", component)
    whole = path.read_bytes()
    with h5py.File(path) as file:
        chunk = file["modes/zeta"].id.get_chunk_info(0)
    spoilt = bytearray(whole)
    spoilt[chunk.byte_offset + chunk.size // 2] ^= 1
    path.write_bytes(spoilt)
    with pytest.raises(ReadError, match=r"chain\.h5.*damaged"):
        read_component(path)


@pytest.mark.parametrize(
    ("item", "says"),
    [
        ("modes", "group 'modes' is missing"),
        ("units", "group 'units' is missing"),
        ("modes/zeta", "dataset 'modes/zeta' is missing"),
        ("nodes/translation", "dataset 'nodes/translation' is missing"),
        ("interfaces/end/shapes", "dataset 'interfaces/end/shapes' is missing"),
        ("integrals", "dataset 'integrals/mass' is missing"),
    ],
)
def test_what_is_missing_is_named(tmp_path, component, item, says):
    path = written(tmp_path / "chain.h5", component)
    with h5py.File(path, "r+") as file:
        del file[item]
    with pytest.raises(ReadError, match=says):
        read_component(path)


def test_arrays_that_do_not_fit_each_other_are_named(tmp_path, component):
    path = written(tmp_path / "chain.h5", component)
    with h5py.File(path, "r+") as file:
        m = file["modes/omega"].size
        del file["dofs/shapes"]
        file["dofs/shapes"] = np.zeros((6, m + 1))
    with pytest.raises(ReadError, match=rf"'dofs/shapes' has shape \(6, {m + 1}\), where \(6, {m}\) fits"):
        read_component(path)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:3000]), "damaged"),
        (lambda path: path.write_bytes(b"no HDF5 at all"), "damaged"),
        (lambda path: h5py.File(path, "r+").attrs.modify("format_version", 99), "newer"),
        (lambda path: h5py.File(path, "r+").attrs.create("format_version", "one"), "format_version one is not valid"),
        (lambda path: h5py.File(path, "r+").attrs.modify("format", "other"), "no component file"),
        (lambda path: path.unlink(), "no such file"),
    ],
    ids=["truncated", "not HDF5", "newer", "no version", "another format", "missing"],
)
def test_spoiled_files_are_refused_by_name(tmp_path, component, spoil, says):
    path = written(tmp_path / "chain.h5", component)
    spoil(path)
    with pytest.raises(ReadError, match=rf"chain\.h5.*{says}"):
        read_component(path)


def test_what_parameters_add_reads_back_and_must_fit_the_modes(tmp_path, component):
    m = component.omega.size
    chance = np.random.default_rng(4)
    K, D = (A + A.T for A in chance.standard_normal((2, m, m)))
    terms = (ParameterTerm("spin", "K", K, 2), ParameterTerm("spin", "D", D))
    path = written(tmp_path / "spun.h5", replace(component, terms=terms))
    found = {term.letter: term for term in read_component(path).parameter_terms}
    assert {letter: (term.parameter, term.power) for letter, term in found.items()} == {
        "K": ("spin", 2),
        "D": ("spin", 1),
    }
    np.testing.assert_array_equal(found["K"].matrix, K)
    assert found["K"].factor({"spin": 3.0}) == 9.0
    with h5py.File(path, "r+") as file:
        del file["parameters/spin/damping"]
        file["parameters/spin/damping"] = np.zeros((m, m - 1))
    with pytest.raises(ReadError, match="parameters/spin/damping"):
        read_component(path)
    assert read_component(written(tmp_path / "bare.h5", component)).parameter_terms == ()
