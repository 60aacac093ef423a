"""Results of one study in several processes: equal but for rounding.

Processes that share the cores have fewer threads each than one alone, and a library sums in another order then.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

# Figures lose what the conditioning of a study makes of rounding: 1e-9 of an error of 1e-2, all digits of one of 1e-9.
RELATIVE, ABSOLUTE = 1e-6, 1e-9


def assert_close(one: object, other: object, where: str = "") -> None:
    """Equal texts and whole numbers, figures equal to what rounding in another order of summation costs."""
    if isinstance(one, dict):
        assert isinstance(other, dict) and set(one) == set(other), where
        for key in one:
            assert_close(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, (list, tuple)):
        assert isinstance(other, (list, tuple)) and len(one) == len(other), where
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_close(a, b, f"{where}[{k}]")
    elif isinstance(one, float):
        assert other == pytest.approx(one, rel=RELATIVE, abs=ABSOLUTE, nan_ok=True), where
    else:
        assert one == other, where


def assert_files_close(one: Path, other: Path) -> None:
    """The same datasets in two HDF5 files, numbers to rounding of the largest of each; not when they were made."""
    first, second = contents(one), contents(other)
    assert set(first) == set(second), one.name
    for name, values in first.items():
        same = second[name]
        assert values.shape == same.shape and values.dtype == same.dtype, f"{one.name}: {name}"
        if values.dtype.kind == "f" and values.size:
            np.testing.assert_array_equal(np.isfinite(values), np.isfinite(same), f"{one.name}: {name}")
            finite = np.isfinite(values)
            size = abs(values[finite]).max(initial=0.0)
            np.testing.assert_allclose(
                same[finite], values[finite], rtol=0, atol=RELATIVE * size, err_msg=f"{one.name}: {name}"
            )
        else:
            np.testing.assert_array_equal(same, values, f"{one.name}: {name}")


def contents(path: Path) -> dict[str, np.ndarray]:
    """Everything in an HDF5 file but its provenance, and the seal that holds digests of it."""
    found: dict[str, np.ndarray] = {}

    def take(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and "provenance" not in name and not name.startswith("seal/"):
            found[name] = np.asarray(item[()])

    with h5py.File(path) as file:
        file.visititems(take)
    return found
