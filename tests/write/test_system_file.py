"""system.h5 holds the assembled system and its natural frequencies."""

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import scipy.sparse as sp

from cmsreduce.model import Configuration, Joint, JointElement, Point, System, Units
from cmsreduce.write import write_system

PAGE = Path(__file__).parents[2] / "docs" / "component-file.md"
STIFFNESS = 40.0


def pendulum(**changes) -> System:
    """Two masses of 1 and 3 on a spring, floating: w^2 = k (1 + 1/3)."""
    M, K = np.diag([1.0, 3.0]), STIFFNESS * np.array([[1.0, -1.0], [-1.0, 1.0]])
    system = System(
        configuration=Configuration("spin=45", {("spin", 5): np.pi / 4}),
        T=np.eye(2),
        M=M,
        K=K,
        D=None,
        loss=None,
        B=np.array([[1.0], [0.0]]),
        C1=np.array([[0.0, 1.0]]),
        C2=np.zeros((1, 2)),
        rigid=np.full((2, 1), 0.5),
        sizes={"stator": 1, "rotor": 1},
        inputs=("motor",),
        outputs=("gyro",),
    )
    return replace(system, **changes)


def sparse(system: System) -> System:
    return replace(system, M=sp.csc_array(system.M), K=sp.csc_array(system.K), T=sp.csc_array(system.T))


def test_system_reads_back(tmp_path):
    path = tmp_path / "system.h5"
    second = pendulum(configuration=Configuration("spin=0"), loss=0.01 * pendulum().K)
    write_system(path, [pendulum(), second], provenance={"notes": []}, units=Units.parse("mm-t-s"))
    with h5py.File(path) as file:
        assert (file.attrs["format"], file.attrs["format_version"]) == ("cmsreduce-system", 2)
        assert file["units"].attrs["length_in_si"] == 1e-3
        first = file["configuration_0"]
        assert first.attrs["name"] == "spin=45"
        assert first.attrs["setting spin.rz"] == np.pi / 4
        for name in ("M", "K", "T", "B", "C1", "C2", "rigid"):
            np.testing.assert_array_equal(first[name], getattr(pendulum(), name))
        assert "D" not in first
        # In the order of the rows of T, not of the alphabet.
        assert first["bodies"].asstr()[:].tolist() == ["stator", "rotor"]
        assert first["inputs"].asstr()[:].tolist() == ["motor"]
        expected = [0.0, np.sqrt(STIFFNESS * 4 / 3) / (2 * np.pi)]
        np.testing.assert_allclose(first["frequency_hz"], expected, rtol=1e-14)
        np.testing.assert_array_equal(file["configuration_1/loss"], 0.01 * pendulum().K)


def test_what_is_sparse_is_written_sparse(tmp_path):
    write_system(tmp_path / "system.h5", [sparse(pendulum())], provenance={})
    with h5py.File(tmp_path / "system.h5") as file:
        group = file["configuration_0"]
        for name in ("M", "K", "T"):
            parts = group[name]
            read = sp.csc_array(tuple(parts[p][()] for p in ("data", "indices", "indptr")), shape=tuple(parts["shape"]))
            np.testing.assert_array_equal(read.toarray(), getattr(pendulum(), name))
        assert "frequency_hz" not in group


def test_every_item_on_the_page_is_in_the_file(tmp_path):
    _, _, page = PAGE.read_text(encoding="utf-8").partition("## system.h5")
    table = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    items = [item for cell in table for item in re.findall(r"`([^`]+)`", cell)]
    K = pendulum().K
    whole, quantities = pendulum(D=0.1 * K, loss=0.2 * K), (["torque"], ["rotation"])
    write_system(tmp_path / "system.h5", [whole], provenance={}, quantities=quantities)
    with h5py.File(tmp_path / "system.h5") as file:
        assert set(items) == set(file["configuration_0"])


def test_joints_and_what_they_own(tmp_path):
    ends = Point("stator", "bearing"), Point("rotor", "bearing")
    spin = Joint("spin", *ends, frozenset({0, 5}), elements=(JointElement(5, 120.0, 0.4, 1e-3), JointElement(0, 7.0)))
    weld = Joint("weld", *ends)
    system = pendulum(joints=(spin, weld), notes=("redundant joints: weld x",))
    write_system(tmp_path / "system.h5", [system], provenance={})
    with h5py.File(tmp_path / "system.h5") as file:
        group = file["configuration_0"]
        assert group["notes"].asstr()[:].tolist() == ["redundant joints: weld x"]
        own = group["joints/spin"]
        assert dict(own.attrs) == {
            "first": "stator.bearing", "second": "rotor.bearing", "free": "x rz", "body": "joint spin"
        }  # fmt: skip
        assert own["dof"].asstr()[:].tolist() == ["rz", "x"]
        figures = {name: own[name][()].tolist() for name in ("stiffness", "damping", "inertia")}
        assert figures == {"stiffness": [120.0, 7.0], "damping": [0.4, 0.0], "inertia": [1e-3, 0.0]}
        assert "first interface" in own["inertia"].attrs["about"]
        assert dict(group["joints/weld"].attrs)["free"] == "" and not list(group["joints/weld"])


def test_a_system_of_no_coordinates(tmp_path):
    none = np.empty((0, 0))
    empty = pendulum(M=none, K=none, T=np.empty((2, 0)), B=np.empty((0, 1)), C1=np.empty((1, 0)), C2=np.empty((1, 0)))
    write_system(tmp_path / "system.h5", [replace(empty, rigid=np.empty((0, 0)))], provenance={})
    with h5py.File(tmp_path / "system.h5") as file:
        assert file["configuration_0/frequency_hz"].shape == (0,)
        assert file["configuration_0/T"].shape == (2, 0)
