"""What holds for every target: its files state their units, and a name with a line break stays in its line."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from cmsreduce.model import Units, in_units
from cmsreduce.write import convert, write_component
from cmsreduce.write.targets import TARGETS
from tests.consumers.bodies import modes
from tests.frames import frame

# Files in SI whatever the units of the body, by what they say of it.
SI = {"42": "units m-kg-s", "extptfm": "(Units kg, m)", "radioss": "kg, m, s", "simscape": "Units: m, kg, s"}
BINARY = {".op4", ".mat", ".h5", ".npz", ".fmu"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Component file of a frame of bars in mm-t-s for each target; its name has a line break."""
    folder, found = tmp_path_factory.mktemp("panel"), {}
    xyz = [[0.8, 0, 0], [1.1, 0, 0], [1.4, 0, 0], [1.4, 0.25, 0.1]]
    for ends in ({"tip": 4}, {"root": 1, "middle": 2, "tip": 4}):
        body = in_units(frame("panel", xyz, [(1, 2), (2, 3), (3, 4)], ends), Units.parse("mm-t-s"))
        path = folder / f"{len(ends)}.h5"
        component = modes(replace(body, name="left\n1.0 2.0"))
        write_component(
            path, component, nodes=(), inputs={}, outputs={}, checks=(), provenance={"settings": {}}, all_nodes=True
        )
        found |= {name: path for name in TARGETS if (name == "extptfm") == (len(ends) == 1)}
    return found


def said(path: Path) -> str:
    """Words of a file, of whatever kind it is."""
    match path.suffix:
        case ".fmu":
            return zipfile.ZipFile(path).read("modelDescription.xml").decode()
        case ".npz":
            with np.load(path) as arrays:
                return str(arrays["units"])
        case ".mat":
            return str(scipy.io.loadmat(path).get("units"))
        case ".h5":
            with h5py.File(path) as file:
                return f"{dict(file.attrs)} {dict(file['units'].attrs) if 'units' in file else ''}"
    return path.read_bytes().decode("latin-1")


@pytest.mark.parametrize("target", TARGETS)
def test_files_state_their_units_and_keep_a_name_in_its_line(
    files: dict[str, Path], tmp_path: Path, target: str
) -> None:
    made = convert(files[target], tmp_path / f"out{TARGETS[target].suffix}", target)
    words = "t.mm/s2" if target == "fmi" else SI.get(target, "mm-t-s")
    assert any(words in said(path) for path in made), words
    for path in made:
        assert path.suffix in BINARY or not any(line.startswith("1.0 2.0") for line in said(path).splitlines())
