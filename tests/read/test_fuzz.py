"""A file that is damaged anywhere is read, or refused with a clear message, in little memory."""

from __future__ import annotations

import random
import tracemalloc
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cmsreduce.errors import CmsReduceError
from cmsreduce.read import matrix_names, read_geometry, read_matrix
from tests.read.mutations import damaged, samples

# The files have a kilobyte: a damaged size must not make the reader allocate memory of that size.
MOST = 64 * 2**20
CASES = 60
GEOMETRY = ("deck.bdf", "mesh.inp", "mesh.frd", "nodes.txt")
NAMES = (
    *GEOMETRY,
    *("dmig.pch", "abaqus.mtx", "calculix.sti", "binary.op2", "wide.op2", "dense.op4", "bigmat.op4", "nonbigmat.op4"),
    *(
        "printed.op4",
        "sparse.op4",
        "market.mtx",
        "array.mtx",
        "harwell.hb",
        "level5.mat",
        "struct.mat",
        "packed.mat",
        "level4.mat",
    ),
    *("dense.npy", "arrays.npz", "sparse.npz"),
)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A good file of each format."""
    return samples(tmp_path_factory.mktemp("good"))


def all_matrices(path: Path) -> None:
    for info in matrix_names(path):
        read_matrix(path, info.name)


@pytest.mark.parametrize("name", NAMES)
def test_damaged_anywhere(name: str, good: dict[str, bytes], tmp_path: Path) -> None:
    read: Callable[[Path], Any] = read_geometry if name in GEOMETRY else all_matrices
    path, chance, refused = tmp_path / name, random.Random(name), 0
    path.write_bytes(good[name])
    read(path)
    tracemalloc.start()
    try:
        for _ in range(CASES):
            path.write_bytes(damaged(good[name], chance))
            try:
                with warnings.catch_warnings():
                    # Libraries may warn of odd files; numbers that overflow are an error of cmsreduce.
                    warnings.simplefilter("ignore", UserWarning)
                    read(path)
            except CmsReduceError as error:
                refused += 1
                assert str(path) in str(error), "the message names the file"
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()
    assert refused > CASES // 4
