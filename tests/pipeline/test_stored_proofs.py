"""A body is read and proven once; a stored proof is taken only for the same files, keys and code."""

from __future__ import annotations

import fcntl
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.errors import DofMapError
from cmsreduce.model import RunResult
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.store import DIAGNOSTICS
from tests.pipeline.study import PIPELINE, Log, arm, write_body
from tests.pipeline.test_reuse import done

COUNT = "the count of motions of negative mass of '{}'"


def proven(run: Run) -> list[str]:
    """Bodies that a run read and proved itself, by name: two at once end in any order."""
    return sorted(entry.removeprefix("read ") for entry in run.stages.progress.done if entry.startswith("read "))


def reads(run: Run, study: Path) -> RunResult:
    found = execute(run, study, report=False)
    assert found is not None
    return found


@pytest.fixture
def twice(opened: Callable[..., Run], study: Path) -> tuple[Run, RunResult]:
    """The study after a run of its own."""
    run = opened()
    return run, reads(run, study)


def test_the_second_run_reads_no_file_and_says_the_same(
    twice: tuple[Run, RunResult], opened: Callable[..., Run], study: Path
) -> None:
    first, found = twice
    assert proven(first) == ["arm", "panel"]
    again = opened()
    result = reads(again, study)
    assert proven(again) == []
    assert result.verdict == found.verdict
    assert len(result.verdict.proofs) > 5
    for name, flexible in again.bodies.items():
        own = first.bodies[name]
        assert flexible.fingerprint == own.fingerprint
        assert (flexible.proofs, flexible.checks, flexible.notes) == (own.proofs, own.checks, own.notes)
        assert (flexible.body.K != own.body.K).nnz == (flexible.body.M != own.body.M).nnz == 0
        assert flexible.body.sources == own.body.sources
        np.testing.assert_array_equal(flexible.rigid, own.rigid)
        assert flexible.health.mass["geometry"].mass.tolist() == own.health.mass["geometry"].mass.tolist()


@pytest.mark.usefixtures("twice")
def test_another_law_of_damping_needs_no_new_proof(opened: Callable[..., Run]) -> None:
    run = opened("components.arm.damping.modal=0.07", "scene.band=50 Hz")
    assert run.bodies["arm"].body.damping.modal == 0.07
    assert run.bodies["panel"].body.damping.modal == 0.01
    assert proven(run) == []


@pytest.mark.usefixtures("twice")
def test_other_units_ties_and_rows_are_proven_anew(opened: Callable[..., Run]) -> None:
    assert proven_of(opened("components.panel.interfaces.root.node=2"), "panel") == ["panel"]
    assert proven_of(opened("components.panel.grounded=false"), "arm") == []
    assert proven_of(opened("components.arm.rows={set: a, trusted: true}"), "arm") == ["arm"]


def proven_of(run: Run, name: str) -> list[str]:
    run.flexible(name)
    return proven(run)


@pytest.mark.usefixtures("twice")
def test_a_changed_file_is_proven_anew_and_a_shuffled_one_refused(opened: Callable[..., Run], study: Path) -> None:
    body = arm()
    order = np.r_[6:12, :6, 12 : body.n]
    K = body.K[order][:, order]
    object.__setattr__(body, "K", K)
    write_body(study.parent, body)
    with pytest.raises(DofMapError, match=r"row order of the stiffness matrix .* is not proven"):
        execute(opened(), study)


def test_a_change_of_an_included_file_is_seen(opened: Callable[..., Run], study: Path) -> None:
    deck, part = study.parent / "arm.bdf", study.parent / "grids.bdf"
    part.write_text(deck.read_text().replace("BEGIN BULK\n", "").replace("ENDDATA\n", ""))
    deck.write_text("BEGIN BULK\nINCLUDE 'grids.bdf'\nENDDATA\n")
    assert proven_of(opened(), "arm") == ["arm"]
    assert proven_of(opened(), "arm") == []
    part.write_text(part.read_text().replace("8.000000000E-01", "8.100000000E-01"))
    with pytest.raises(DofMapError, match="is not proven"):
        opened().flexible("arm")


@pytest.mark.usefixtures("twice")
def test_a_damaged_proof_is_made_anew(opened: Callable[..., Run], study: Path) -> None:
    path = study.parent / "out" / "stages" / "arm.read.h5"
    content = bytearray(path.read_bytes())
    # A number of the matrices.
    with h5py.File(path) as file:
        at = file["short.f8"].id.get_chunk_info(0).byte_offset
    content[at + 6] ^= 1
    path.write_bytes(content)
    run = opened()
    assert proven_of(run, "arm") == ["arm"]
    assert any("arm.read.h5 is damaged and is made again" in note for note in run.stages.progress.notes)
    path.write_bytes(content[: len(content) // 2])
    assert proven_of(opened(), "arm") == ["arm"]
    assert proven_of(opened(), "arm") == []


def test_a_proof_with_a_part_that_failed_is_made_again(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no count")

    with monkeypatch.context() as patched:
        patched.setitem(DIAGNOSTICS, COUNT, broken)
        failed = opened()
        result = reads(failed, study)
        assert failed.stages.failures.broken and not result.verdict.passed
        # A second run says it again.
        again = opened()
        assert not reads(again, study).verdict.passed and again.stages.failures.broken
    sound = opened()
    assert reads(sound, study).verdict.passed
    assert proven(sound) == ["arm", "panel"]


def test_a_body_that_another_process_proves_is_asked_for_last(opened: Callable[..., Run]) -> None:
    run = opened()
    lock = run.folder / "stages" / ".arm.read.h5.lock"
    lock.parent.mkdir(parents=True)
    with lock.open("a") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        order = run.at_hand(["arm", "panel"])
        assert next(order) == "panel"
        fcntl.flock(handle, fcntl.LOCK_UN)
        assert list(order) == ["arm"]


def test_a_body_with_wheels_is_read_anew(opened: Callable[..., Run], study: Path) -> None:
    wheel = "    wheels: {{fly: {{at: 3, momentum: 2.0, axis: x}}}}\n"
    text = PIPELINE.replace("    geometry: arm.bdf\n", "    geometry: arm.bdf\n" + wheel)
    assert proven_of(opened(text=text), "arm") == proven_of(opened(text=text), "arm") == ["arm"]
    assert not (study.parent / "out" / "stages" / "arm.read.h5").exists()


def test_a_run_is_the_same_whatever_folder_its_command_is_called_in(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `cmsreduce run study.yaml` beside the file, then `report` or a run elsewhere: no body is proven again."""
    monkeypatch.chdir(study.parent)
    first = Run(load_pipeline(Path(study.name)), study.parent / "out", Log())
    reads(first, study)
    monkeypatch.chdir(tmp_path)
    again = Run(load_pipeline(study), study.parent / "out", Log())
    reads(again, study)
    assert (proven(first), proven(again), done(again)) == (["arm", "panel"], [], [])
    # Elements are drawn from the files of the deck.
    assert all(Path(source.path).is_file() for source in again.bodies["arm"].body.sources)
