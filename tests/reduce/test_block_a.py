"""A solid block against Sierra's own Craig-Bampton superelement."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.model import FEModel, ReducedComponent
from cmsreduce.read import InterfaceSpec, MatrixSource, read_body
from cmsreduce.reduce import CraigBampton

pytestmark = pytest.mark.shared


@pytest.fixture(scope="module")
def sierra(shared_data: Path) -> dict[str, np.ndarray]:
    with np.load(shared_data / "block_a" / "reference.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def body(shared_data: Path, sierra) -> FEModel:
    folder = shared_data / "block_a"
    nodes = tuple(dict.fromkeys(sierra["boundary"][:, 0].tolist()))
    return read_body(
        "block",
        stiffness=MatrixSource(folder / "block_a.op4", "KAA", None),
        mass=MatrixSource(folder / "block_a.op4", "MAA", None),
        geometry=folder / "block_a.bdf",
        interfaces={"boundary": InterfaceSpec(nodes, None, None, None)},
    )


@pytest.fixture(scope="module")
def reduced(body, sierra) -> ReducedComponent:
    last = np.sqrt(sierra["fixed_interface_eigenvalues"][-1]) / (2 * np.pi)
    return CraigBampton(last).reduce(body, body.interface_rows("boundary"))


def test_fixed_interface_eigenvalues(reduced, sierra):
    eigenvalues = (2 * np.pi * reduced.modes.source_hz[75:]) ** 2
    np.testing.assert_allclose(eigenvalues[:30], sierra["fixed_interface_eigenvalues"], rtol=1e-11)
    # Sierra's last mode is half of a pair, which is not split here.
    assert eigenvalues.size == 31
    assert eigenvalues[30] == pytest.approx(eigenvalues[29], rel=1e-9)


@pytest.mark.parametrize("letter", ["K", "M"])
def test_interface_matrices(reduced, sierra, letter):
    expected = sierra[f"{letter}bb"]
    np.testing.assert_allclose(getattr(reduced, letter)[:75, :75], expected, rtol=0, atol=1e-11 * abs(expected).max())


def test_modes_couple_to_the_interface_as_sierra_s_do(reduced, sierra):
    mine, theirs = reduced.M[75:105, :75], sierra["Mqb"]
    w = np.sqrt(sierra["fixed_interface_eigenvalues"])
    start, size = 0, abs(theirs).max()
    while start < 29:
        stop = start + 1
        while stop < 30 and w[stop] < w[start] * (1 + 1e-7):
            stop += 1
        if stop == 30:
            break
        a, b = mine[start:stop], theirs[start:stop]
        # Inside a repeated mode any rotation is as good, otherwise the sign is.
        turn, _ = la.orthogonal_procrustes(a.T, b.T)
        np.testing.assert_allclose(turn.T @ a, b, atol=2e-7 * size)
        start = stop
    assert start >= 28
