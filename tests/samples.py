"""Whether a sample's files are what its script makes."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
from pyyeti.nastran import op4

__all__ = ["assert_made_again"]


def assert_made_again(sample: Path, folder: Path) -> None:
    """Run ``write`` of the sample's ``make.py``: the same decks, and the same matrices to rounding."""
    spec = importlib.util.spec_from_file_location(f"make_{sample.name}", sample / "make.py")
    module = importlib.util.module_from_spec(spec)
    # Data classes look their module up by its name.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    module.write(folder)
    decks, matrices = sorted(sample.glob("*.bdf")), sorted(sample.glob("*.op4"))
    assert decks and len(decks) == len(matrices) == len(list(folder.iterdir())) / 2
    for deck in decks:
        assert (folder / deck.name).read_text() == deck.read_text()
    for file in matrices:
        kept, made = op4.read(str(file)), op4.read(str(folder / file.name))
        assert kept.keys() == made.keys()
        for name in kept:
            # Other BLAS builds round sums differently in the last digit.
            np.testing.assert_allclose(made[name], kept[name], rtol=0, atol=1e-12 * abs(kept[name]).max())
