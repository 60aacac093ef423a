"""A finished stage belongs to the code that made it, and to no more of it than it depends on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import cmsreduce
from cmsreduce.pipeline.store import code_version

STAGES = ("read", "reduce", "orthogonalise", "reference", "cutoff", "balance", "verify")
PACKAGE = Path(cmsreduce.__file__).parent


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("code") / "cmsreduce"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


@pytest.mark.parametrize(
    ("file", "concerned"),
    [
        ("report/page/page.py", ()),
        ("write/summary/summary.py", ()),
        ("read/nastran/op4.py", ()),
        ("cli/__main__.py", ()),
        ("verify/response_error.py", ("cutoff", "balance", "verify")),
        ("balance/modal_gain.py", ("cutoff", "balance", "verify")),
        ("reduce/craig_bampton.py", ("reduce", "reference", "cutoff", "balance", "verify")),
        ("orthogonalise.py", ("orthogonalise", "reference", "cutoff", "balance", "verify")),
        ("mechanics/ties.py", ("reduce", "orthogonalise", "reference", "cutoff", "balance", "verify")),
        ("linalg/sparse/factorisation.py", ("reduce", "orthogonalise", "reference", "cutoff", "balance", "verify")),
    ],
)
def test_a_change_concerns_the_stages_that_use_it(package: Path, file: str, concerned: tuple[str, ...]) -> None:
    code_version.cache_clear()
    before = {stage: code_version(stage, package) for stage in STAGES}
    path = package / file
    text = path.read_bytes()
    path.write_bytes(text + b"\n")
    code_version.cache_clear()
    after = {stage: code_version(stage, package) for stage in STAGES}
    path.write_bytes(text)
    assert {stage for stage in STAGES if before[stage] != after[stage]} == set(concerned)


def test_a_file_that_moves_is_another_code(package: Path) -> None:
    code_version.cache_clear()
    before = code_version("reduce", package)
    (package / "reduce/guyan_moved.py").write_bytes((package / "reduce/basis.py").read_bytes())
    code_version.cache_clear()
    assert code_version("reduce", package) != before
    (package / "reduce/guyan_moved.py").unlink()
