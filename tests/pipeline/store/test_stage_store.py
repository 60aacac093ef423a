"""Finished stages on disk: damage is noticed, writers and kills do not get in each other's way."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.pipeline.store import share_stages, stage_key
from cmsreduce.pipeline.store.stage_store import StageStore

KEY = stage_key("reduce", "anything")
ARRAYS = {"Phi": np.arange(600.0).reshape(12, 50), "omega": np.arange(50.0), "none": np.zeros((0, 3))}
FACTS = {"method": "guyan", "seconds": 1.5}

WRITER = """
import sys
from pathlib import Path
import numpy as np
from cmsreduce.pipeline.store.stage_store import StageStore
store = StageStore(Path(sys.argv[1]))
for _ in range(int(sys.argv[3])):
    store.save("reduce", "rotor", sys.argv[2], {"Phi": np.full((200, 200), float(sys.argv[4]))}, {"by": sys.argv[4]})
"""
HOLDER = """
import sys, time
from pathlib import Path
from cmsreduce.pipeline.store.stage_store import StageStore
with StageStore(Path(sys.argv[1])).claimed("reduce", "rotor", sys.argv[2]):
    print("held", flush=True)
    time.sleep(60)
"""


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
    program = [sys.executable, "-c", WRITER, str(shared), KEY, "60"]
    writers = [subprocess.Popen([*program, value]) for value in ("1", "2")]
    store, seen = StageStore(shared), set()
    while any(writer.poll() is None for writer in writers):
        found = store.load("reduce", "rotor", KEY)
        if found is not None:
            value = float(found[1]["by"])
            assert np.all(found[0]["Phi"] == value)
            seen.add(value)
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen
    assert sorted(path.suffix for path in (shared.parent / "common").iterdir()) == [".h5"]


def test_a_writer_killed_at_any_moment_leaves_a_whole_entry_or_none(shared: Path) -> None:
    program = [sys.executable, "-c", WRITER, str(shared), KEY, "100000", "3"]
    store = StageStore(shared)
    with subprocess.Popen(program) as writer:
        limit = time.monotonic() + 60
        while store.load("reduce", "rotor", KEY) is None and time.monotonic() < limit:
            time.sleep(0.01)
        writer.kill()
    assert writer.returncode == -signal.SIGKILL
    found = store.load("reduce", "rotor", KEY)
    assert found is not None and np.all(found[0]["Phi"] == 3.0)
    # The next writer clears away what the killed one had begun.
    store.save("reduce", "rotor", KEY, ARRAYS, FACTS)
    assert [path.suffix for path in (shared.parent / "common").iterdir()] == [".h5"]


@pytest.mark.skipif(os.name != "posix", reason="locks of the system")
def test_a_claim_is_waited_for_and_ends_with_its_process(shared: Path) -> None:
    program = [sys.executable, "-c", HOLDER, str(shared), KEY]
    with (
        subprocess.Popen(program, stdout=subprocess.PIPE) as holder,
        subprocess.Popen(program, stdout=subprocess.PIPE) as other,
    ):
        ends = {holder.stdout: holder, other.stdout: other}
        (first,), _, _ = select.select(list(ends), [], [], 60)
        assert first.readline() == b"held\n"
        (second,) = set(ends) - {first}
        # The other has started long since and says nothing, until the one that holds the claim is killed.
        assert select.select([second], [], [], 3) == ([], [], [])
        ends[first].kill()
        assert second.readline() == b"held\n"
        ends[second].kill()


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
