"""Finished stages on disk: damage is noticed, writers and kills do not get in each other's way."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.pipeline.store import share_stages, stage_key
from cmsreduce.pipeline.store.stage_store import StageStore

KEY = stage_key("reduce", "anything")
ARRAYS = {"Phi": np.arange(600.0).reshape(12, 50), "omega": np.arange(50.0), "none": np.zeros((0, 3))}
FACTS = {"method": "guyan", "seconds": 1.5}

# A process that begins as a copy of this one has the libraries, which take a second to load.
FORKING = get_context("fork")


def write(folder: Path, times: int, value: float) -> None:
    """Save one entry again and again."""
    store = StageStore(folder)
    for _ in range(times):
        store.save("reduce", "rotor", KEY, {"Phi": np.full((200, 200), value)}, {"by": value})


def hold(folder: Path, told: Connection) -> None:
    """Claim an entry, say so, and keep the claim."""
    with StageStore(folder).claimed("reduce", "rotor", KEY):
        told.send("held")
        time.sleep(60)


def started(target: Callable[..., None], *arguments: object) -> BaseProcess:
    process = FORKING.Process(target=target, args=arguments)
    process.start()
    return process


@pytest.fixture
def shared(tmp_path: Path) -> Path:
    """Run directory that shares a folder of stages."""
    share_stages(tmp_path / "run", tmp_path / "common")
    return tmp_path / "run"


def test_a_shared_entry_is_found_by_another_run_that_shares_and_by_no_other_key(shared: Path) -> None:
    other = shared.parent / "other"
    share_stages(other, shared.parent / "common")
    path = StageStore(shared).save("reduce", "rotor", KEY, ARRAYS, FACTS)
    assert path.parent == (shared.parent / "common").resolve()
    found = StageStore(other).load("reduce", "rotor", KEY)
    assert found is not None and found[1] == FACTS
    np.testing.assert_array_equal(found[0]["Phi"], ARRAYS["Phi"])
    assert StageStore(other).load("reduce", "rotor", stage_key("reduce", "another")) is None
    # What depends on the whole system is each run's own.
    assert StageStore(shared).save("verify", "system", KEY, {}, {}).parent == shared / "stages"
    assert StageStore(other).load("verify", "system", KEY) is None


def test_a_run_and_its_shared_folder_move_together(shared: Path, tmp_path: Path) -> None:
    StageStore(shared).save("reduce", "rotor", KEY, ARRAYS, FACTS)
    (tmp_path / "moved").mkdir()
    for name in ("run", "common"):
        (tmp_path / name).rename(tmp_path / "moved" / name)
    assert StageStore(tmp_path / "moved" / "run").facts("reduce", "rotor", KEY) == FACTS


def test_thousands_of_short_vectors_take_few_datasets(tmp_path: Path) -> None:
    """A scene of 60 actuators and 60 sensors has 3600 arrays of zeros in each configuration."""
    kinds = (np.float64, np.int64, np.bool_, np.complex128)
    arrays = {f"zeros.{k}": np.full(k % 5, k, dtype=kinds[k % 4]) for k in range(3600)}
    arrays |= {"long": np.arange(1000.0), "turned": np.arange(6.0).reshape(2, 3).T}
    store = StageStore(tmp_path)
    with h5py.File(store.save("verify", "system", KEY, arrays, FACTS)) as file:
        assert len(file) == 8
    found = store.load("verify", "system", KEY)
    assert found is not None and found[0].keys() == arrays.keys()
    for name, array in arrays.items():
        assert found[0][name].dtype == array.dtype
        np.testing.assert_array_equal(found[0][name], array)


@pytest.mark.parametrize("share", [False, True])
def test_no_damage_goes_unnoticed(tmp_path: Path, shared: Path, share: bool) -> None:
    said: list[str] = []
    store = StageStore(shared if share else tmp_path / "alone", said.append)
    path = store.save("reduce", "rotor", KEY, ARRAYS, FACTS)
    whole = path.read_bytes()
    spoilt = [whole[:size] for size in (0, 7, 600, len(whole) // 2, len(whole) - 1)]
    for at in range(0, len(whole), 61):
        flipped = bytearray(whole)
        flipped[at] ^= 0x55
        spoilt.append(bytes(flipped))
    for number, damaged in enumerate(spoilt):
        path.write_bytes(damaged)
        before = len(said)
        found = store.load("reduce", "rotor", KEY)
        if found is None:
            # Said with its place, unless the key itself is another one now.
            assert len(said) == before or f"{path} is damaged and is made again" in said[-1]
        else:
            # Bytes that hold nothing, such as the space between datasets.
            assert found[1] == FACTS, number
            assert set(found[0]) == set(ARRAYS)
            for name, array in ARRAYS.items():
                np.testing.assert_array_equal(found[0][name], array)
    assert len(said) > len(spoilt) // 8
    path.write_bytes(whole[:-1])
    assert store.load("reduce", "rotor", KEY) is None and "damaged" in said[-1]
    store.save("reduce", "rotor", KEY, ARRAYS, FACTS)
    assert store.load("reduce", "rotor", KEY) is not None


def test_two_processes_write_one_key_while_a_third_reads(shared: Path) -> None:
    writers = [started(write, shared, 60, value) for value in (1.0, 2.0)]
    store, seen = StageStore(shared), set()
    while any(writer.is_alive() for writer in writers):
        found = store.load("reduce", "rotor", KEY)
        if found is not None:
            value = found[1]["by"]
            assert np.all(found[0]["Phi"] == value)
            seen.add(value)
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert seen
    assert sorted(path.suffix for path in (shared.parent / "common").iterdir()) == [".h5"]


def test_a_writer_killed_at_any_moment_leaves_a_whole_entry_or_none(shared: Path) -> None:
    store = StageStore(shared)
    writer = started(write, shared, 100_000, 3.0)
    limit = time.monotonic() + 60
    while store.load("reduce", "rotor", KEY) is None and time.monotonic() < limit:
        time.sleep(0.01)
    writer.kill()
    writer.join()
    assert writer.exitcode == -signal.SIGKILL
    found = store.load("reduce", "rotor", KEY)
    assert found is not None and np.all(found[0]["Phi"] == 3.0)
    # The next writer clears away what the killed one had begun.
    store.save("reduce", "rotor", KEY, ARRAYS, FACTS)
    assert [path.suffix for path in (shared.parent / "common").iterdir()] == [".h5"]


@pytest.mark.skipif(os.name != "posix", reason="locks of the system")
def test_a_claim_is_waited_for_and_ends_with_its_process(shared: Path) -> None:
    holders: dict[Connection, BaseProcess] = {}
    for _ in range(2):
        here, there = FORKING.Pipe(duplex=False)
        holders[here] = started(hold, shared, there)
    try:
        first, *both = wait(list(holders), 60)
        assert not both and first.recv() == "held"
        (second,) = set(holders) - {first}
        # The other has started as well and says nothing, until the one that holds the claim is killed.
        assert not second.poll(2)
        holders[first].kill()
        assert second.poll(60) and second.recv() == "held"
    finally:
        for process in holders.values():
            process.kill()
            process.join()


def test_a_claim_of_what_is_not_shared_is_no_claim(shared: Path, tmp_path: Path) -> None:
    with StageStore(shared).claimed("verify", "system", KEY) as others:
        assert not others
    with StageStore(tmp_path / "alone").claimed("reduce", "rotor", KEY) as others:
        assert not others


def test_a_pointer_that_cannot_be_read_leaves_the_run_on_its_own(shared: Path) -> None:
    (shared / "stages" / "shared.json").write_text(json.dumps(["no", "folder"]))
    assert StageStore(shared).shared is None


def test_a_pointer_to_anywhere_else_is_not_followed(shared: Path, tmp_path: Path) -> None:
    (shared / "stages" / "shared.json").write_text(json.dumps({"shared": str(tmp_path / "elsewhere" / "stages")}))
    assert StageStore(shared).shared is None
