"""The SID reader of PyMBS, from its sources, on a file that the profile `pymbs` writes."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.write.targets.sid import write_sid
from tests.write.particles import particles
from tests.write.targets.test_sid import read

SOURCES = os.environ.get("CMSREDUCE_PYMBS", "")
"""Folder of the sources, with pymbs/common/sidfilereader.py."""

TERMS = {name: name.lower() for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "Ke", "De")}


@pytest.mark.skipif(not SOURCES, reason="CMSREDUCE_PYMBS names no folder with the sources of PyMBS")
def test_every_array_reaches_the_reader(tmp_path: Path) -> None:
    """A full damping matrix: the reader takes of a symmetric matrix what the file has."""
    body, rng = particles(), np.random.default_rng(2)
    D = rng.normal(size=(4, 4))
    file = replace(body.file, arrays={**body.file.arrays, "modes/damping": D @ D.T})
    write_sid(tmp_path / "body.sid", file, body.integrals, "embs")
    (found,) = Path(SOURCES).rglob("sidfilereader.py")
    spec = importlib.util.spec_from_file_location("sidfilereader", found)
    reader = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reader)
    with (tmp_path / "body.sid").open() as stream:
        modal = reader.SID(stream).modal
    ours = read(tmp_path / "body.sid")
    for name, attribute in TERMS.items():
        block = getattr(modal, attribute)
        (term,) = (each for each in vars(block).values() if hasattr(each, "M0"))
        np.testing.assert_array_equal(np.asarray(term.M0), ours.body[name].m0, err_msg=name)
        if term.order:
            np.testing.assert_array_equal([np.asarray(M) for M in term.M1], np.moveaxis(ours.body[name].m1, 1, 0))
    np.testing.assert_allclose(np.asarray(modal.de.dematrix.M0), D @ D.T, rtol=1e-15, atol=1e-15)
    assert modal.refmod.mass == pytest.approx(body.m.sum(), rel=1e-15)
