"""The component file holds the reduced body, whole, and reads back as its page says."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import ReadError, WriteError
from cmsreduce.model import Check, Damping, DofTable, FEModel, Interface, Nodes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import atomic_path, read_component, write_component

PAGE = Path(__file__).parents[2] / "docs" / "component-file.md"
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
    return orthogonalise(CraigBampton(1e3).reduce(body, body.interface_rows("end")))


def written(path, component, **changes):
    m = component.omega.size
    options = {
        "nodes": [3],
        "inputs": {"push": np.arange(m, dtype=float)},
        "outputs": {"gauge": (np.ones(m), np.zeros(m))},
        "checks": [Check("orthogonality in M", 1e-15, 1e-8)],
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
    assert file.checks == (Check("orthogonality in M", 1e-15, 1e-8),)
    assert file.settings == {"name": "chain"}


def test_integrals_are_those_of_three_point_masses(tmp_path, component):
    arrays = read_component(written(tmp_path / "chain.h5", component)).arrays
    assert arrays["integrals/mass"] == pytest.approx(6.0, rel=1e-14)
    np.testing.assert_allclose(arrays["integrals/first_moment"], [8.0, 0, 0], atol=1e-13)
    np.testing.assert_allclose(arrays["integrals/inertia"], np.diag([0, 14.0, 14.0]), atol=1e-12)
    # Elastic modes of a free body carry no momentum (theory section 7).
    np.testing.assert_allclose(arrays["integrals/int_phi"][:, 3:], 0, atol=1e-12)


def test_shapes_of_a_turned_node_are_given_along_basic_axes(tmp_path, component):
    arrays = read_component(written(tmp_path / "chain.h5", component)).arrays
    k = list(arrays["nodes/id"]).index(3)
    np.testing.assert_allclose(arrays["nodes/translation"][k], TURN.T @ component.Phi[-3:], atol=1e-15)
    assert np.isnan(arrays["nodes/rotation"]).all()


def test_the_lines_on_the_page_read_it(tmp_path, component, monkeypatch):
    written(tmp_path / "rotor.h5", component)
    monkeypatch.chdir(tmp_path)
    found: dict = {}
    exec(re.search(r"```python\n(.*?)```", PAGE.read_text(), re.S)[1], found)
    np.testing.assert_allclose(found["frequencies_hz"], component.omega[3:] / 2 / np.pi, rtol=1e-14)
    assert found["faces"]["end"].shape == (3, component.omega.size)


def test_every_path_on_the_page_is_in_the_file(tmp_path, component):
    table = [line for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    with h5py.File(written(tmp_path / "chain.h5", component)) as file:
        for line in table:
            folder = ""
            for item in re.findall(r"`([^`]+)`", line.split("|")[1]):
                path = item if "/" in item or not folder else f"{folder}/{item}"
                folder = path.rpartition("/")[0]
                if path not in ("modes/loss",):
                    assert path.replace("NAME/", "end") in file, path


def test_same_input_gives_same_bytes(tmp_path, component):
    def stripped(path):
        with h5py.File(path, "r+") as file:
            file.attrs.modify("created_utc", "2000-01-01T00:00:00+00:00")
        return path.read_bytes()

    assert stripped(written(tmp_path / "a.h5", component)) == stripped(written(tmp_path / "b.h5", component))


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:3000]), "damaged"),
        (lambda path: path.write_bytes(b"no HDF5 at all"), "damaged"),
        (lambda path: h5py.File(path, "r+").attrs.modify("format_version", 99), "newer"),
        (lambda path: h5py.File(path, "r+").attrs.modify("format", "other"), "no component file"),
        (lambda path: path.unlink(), "no such file"),
    ],
    ids=["truncated", "not HDF5", "newer", "another format", "missing"],
)
def test_spoiled_files_are_refused_by_name(tmp_path, component, spoil, says):
    path = written(tmp_path / "chain.h5", component)
    spoil(path)
    with pytest.raises(ReadError, match=rf"chain\.h5.*{says}"):
        read_component(path)


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.iterdir()] == ["result.txt"]
    assert path.read_text() == "old"


def test_a_folder_that_cannot_be_made_is_said_clearly(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="cannot be written"), atomic_path(tmp_path / "file" / "x.json"):
        pass


def test_a_killed_writer_leaves_no_half_file(tmp_path):
    path = tmp_path / "result.txt"
    code = (
        "import time, sys; from pathlib import Path; from cmsreduce.write import atomic_path\n"
        "with atomic_path(Path(sys.argv[1])) as t:\n"
        "    t.write_text('half'); print('ready', flush=True); time.sleep(60)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"ready\n"
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    child.stdout.close()
    assert not path.exists()
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps("whole"))
    assert [p.name for p in tmp_path.iterdir()] == ["result.txt"]
