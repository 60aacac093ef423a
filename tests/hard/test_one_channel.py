"""A load over many points is one column of B, a line of sight over two points one row of C, whatever room asks.

Recipes: a beam held at one end under a uniform load, the space station of the SLICOT collection in coordinates in which
every channel takes all of them, and lines of sight over two nodes of one body and of two bodies.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import body_ports
from cmsreduce.balance import hankel_values
from cmsreduce.config import load_pipeline
from cmsreduce.model import Channel, FEModel, Point, PointTerm, RunResult, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.choose.selection import modal_channels
from cmsreduce.reduce import reduction
from tests.frames import line
from tests.pipeline.study import write_body

RANKINGS = ("gregory", "hankel", "component-cost", "modal-gain")

BEAM = """\
name: beam
output: {output}
components:
  beam:
    stiffness: {{file: K.npz}}
    mass: {{file: M.npz}}
    geometry: beam.bdf
    rows: {{file: rows.txt}}
    grounded: true
    damping: {{modal: 0.01}}
scene:
  band: 40 Hz
  actuators: {{wind: {{rows: {{{load}}}}}}}
  sensors: {{tip: {{at: beam.21, measure: z}}}}
reduce: {{cutoff: 40}}
balance: {{rank: {rank}, keep: {{modes: {{beam: 2}}}}}}
verify: {{}}
"""


def finished(path: Path, text: str) -> tuple[Run, RunResult]:
    path.write_text(text)
    pipeline = load_pipeline(path)
    run = Run(pipeline, pipeline.output, Silent())
    result = execute(run, path, report=False)
    assert result is not None
    return run, result


def write_rows(folder: Path, K: sp.csc_array, M: sp.csc_array, rows: list[str]) -> None:
    for name, A in (("K", K), ("M", M)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array(A))
    (folder / "rows.txt").write_text("\n".join(rows))


@pytest.mark.parametrize("rank", RANKINGS)
def test_two_modes_carry_a_uniform_load(tmp_path: Path, rank: str) -> None:
    """A beam without its first node: 20 nodes are loaded, and a band of three modes needs two shapes."""
    body = line("beam", [0, 0, 0], [1, 0, 0], 20)
    write_body(tmp_path, body)
    free = np.arange(6, body.n)
    labels = [f"{body.dofs.node[k]}.{body.dofs.component[k]}" for k in free]
    write_rows(tmp_path, body.K[free][:, free], body.M[free][:, free], labels)
    load = ", ".join(f"beam.{node}.z: 0.05" for node in range(2, 22))
    text = BEAM.format(output=tmp_path / "out", load=load, rank=rank)
    run, result = finished(tmp_path / "beam.yaml", text)
    ports = run.bodies["beam"].ports
    assert ports.interface.size == 0 and ports.loads.shape[1] == 1
    # One static shape of the load, not 20.
    assert sum(kind == "residual" for kind in run.modal("beam").kind) <= 1
    assert run.final["beam"].elastic_count == 2
    assert result.worst()["frf_error"] < 3e-4


STATION = """\
name: station
output: {output}
components:
  iss:
    stiffness: {{file: K.npz}}
    mass: {{file: M.npz}}
    rows: {{file: rows.txt}}
    grounded: true
    damping: {{modal: 0.005}}
scene:
  band: [0.0159 Hz, 15.9 Hz]
  actuators:
{actuators}
  sensors:
{sensors}
reduce: {{cutoff: 8}}
balance: {{rank: hankel, keep: {{modes: {{iss: 17}}}}}}
verify: {{}}
"""


@pytest.mark.shared
def test_the_space_station_by_hankel_values(tmp_path: Path, shared_data: Path) -> None:
    """ISS-1R: its published Hankel values, and 1 % with 17 modes (theory section 4)."""
    from scipy.io import loadmat

    file = loadmat(shared_data / "slicot" / "iss.mat")
    A, B, C = (np.asarray(file[k].todense() if hasattr(file[k], "todense") else file[k], dtype=float) for k in "ABC")
    n = A.shape[0] // 2
    # In these coordinates every actuator and sensor takes all dofs, and the body is one piece.
    Q = np.linalg.qr(np.random.default_rng(1).standard_normal((n, n)))[0]
    K = Q @ -A[n:, :n] @ Q.T
    write_rows(tmp_path, sp.csc_array((K + K.T) / 2), sp.eye_array(n, format="csc"), [f"{k + 1}.1" for k in range(n)])

    def rows(row: np.ndarray) -> str:
        return "{" + ", ".join(f"iss.{k + 1}.x: {float(weight)!r}" for k, weight in enumerate(Q @ row)) + "}"

    actuators = "\n".join(f"    u{k}: {{rows: {rows(B[n:, k])}}}" for k in range(B.shape[1]))
    sensors = "\n".join(f"    y{k}: {{rows: {rows(C[k, n:])}, rate: true}}" for k in range(C.shape[0]))
    text = STATION.format(output=tmp_path / "out", actuators=actuators, sensors=sensors)
    run, result = finished(tmp_path / "station.yaml", text)
    ports = run.bodies["iss"].ports
    assert (ports.interface.size, ports.loads.shape[1], ports.rates.shape[0]) == (0, 3, 3)
    values = hankel_values(modal_channels(run.modal("iss"), ports))[:6]
    np.testing.assert_allclose(values, [0.0579427, 0.0579401, 0.0168977, 0.0168961, 0.0060103, 0.0060102], atol=6e-8)
    assert run.final["iss"].elastic_count == 17
    assert result.worst()["frf_error"] < 0.01


def bar(name: str = "bar", **options: object) -> FEModel:
    return line(name, [0, 0, 0], [1.5, 0, 0], 6, interfaces={"root": 1, "tip": 7}, **options)


def over(name: str, terms: dict[str, float], *, rate: bool = False) -> Channel:
    """A channel over several z motions, ``body.point: weight``."""
    parts = [(Point(*text.split(".")), weight) for text, weight in terms.items()]
    z = np.eye(6)[2]
    return Channel(name, tuple(PointTerm(at, weight * z) for at, weight in parts), "translation", rate)


def scene(actuators: tuple[Channel, ...] = (), sensors: tuple[Channel, ...] = ()) -> Scene:
    return Scene(("bar", "other"), (0.0, 100.0), actuators=actuators, sensors=sensors)


def z_of(body: FEModel, node: int) -> int:
    return int(body.dofs.rows(node, np.array([3]))[0])


@pytest.mark.parametrize("rate", [False, True])
def test_a_line_of_sight_is_one_row_of_each_body(rate: bool) -> None:
    body = bar()
    here = over("sight", {"bar.2": 1.0, "bar.6": -2.0}, rate=rate)
    both = over("both", {"bar.3": 0.5, "other.4": 1.0, "bar.5": 1.5, "other.2": -1.0}, rate=rate)
    ports = body_ports(body, scene(sensors=(here, both)), ["sensors"])
    rows, none = (ports.rates, ports.displacements) if rate else (ports.displacements, ports.rates)
    expected = np.zeros((2, body.n))
    expected[0, [z_of(body, 2), z_of(body, 6)]] = 1.0, -2.0
    expected[1, [z_of(body, 3), z_of(body, 5)]] = 0.5, 1.5
    np.testing.assert_array_equal(rows.toarray(), expected)
    assert none.shape[0] == 0 and ports.residuals.shape[1] == 2
    there = body_ports(bar("other"), scene(sensors=(here, both)))
    assert there.displacements.shape[0] + there.rates.shape[0] == 1


def test_a_load_over_points_leaves_the_interface_to_joints() -> None:
    """Nodes of the load that joints need stay interfaces; the load is one column beside them, zero nowhere."""
    body = bar()
    load = over("wind", {f"bar.{node}": 0.1 for node in range(1, 8)})
    ports = body_ports(body, scene(actuators=(load,)))
    assert ports.interface.tolist() == [*body.interface_rows("root"), *body.interface_rows("tip")]
    np.testing.assert_allclose(ports.loads[[z_of(body, node) for node in range(1, 8)], 0], 0.1)
    # A force at one point, also as rows, is in the interface as ever.
    single = body_ports(body, scene(actuators=(over("force", {"bar.4": 2.0}),)))
    assert single.interface[-1] == z_of(body, 4) and single.loads.shape[1] == 0


@pytest.mark.parametrize("method", ["craig-bampton", "guyan", "macneal-rubin", "benfield-hruda", "augmented"])
def test_every_mode_set_answers_the_load_statically_by_one_shape(method: str) -> None:
    """The deflection under loads at 5 nodes in balance, against dense algebra: one residual shape is enough."""
    body = bar()
    weights = {2: 1.0, 3: -1.0, 4: 0.0, 5: -1.0, 6: 1.0}
    load = over("wind", {f"bar.{node}": weight for node, weight in weights.items()})
    ports = body_ports(body, scene(actuators=(load,)))
    reduced = reduction(method, 40.0).reduce(body, ports.interface, ports.static_loads)
    assert sum(label.startswith("load") for label in reduced.modes.label) <= 1
    modal = orthogonalise(reduced)
    f = ports.loads[:, 0]
    exact = np.linalg.lstsq(body.K.toarray(), f, rcond=1e-12)[0]
    Phi, k = modal.Phi[:, modal.rigid_count :], modal.stiffness[modal.rigid_count :]
    found = Phi @ ((Phi.T @ f) / k)
    gap = found - exact
    assert abs(f @ gap) < 1e-9 * (f @ exact) and gap @ (body.K @ gap) < 1e-12 * (exact @ (body.K @ exact))
