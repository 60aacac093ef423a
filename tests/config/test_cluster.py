"""Cluster files: what is taken, and how what is wrong is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from cmsreduce.config import load_cluster
from cmsreduce.errors import CmsReduceError

PRESETS = sorted((Path(__file__).parents[2] / "configs").glob("cluster-*.yaml"))


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_presets_are_good(path: Path) -> None:
    assert load_cluster(path).kind == path.stem.removeprefix("cluster-")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kind: slrum\n", "c.yaml:1: key 'kind': found the text 'slrum', did you mean 'slurm'?"),
        ("kind: slurm\n", "c.yaml:1: kind: slurm needs memory, e.g. memory: 16 GiB"),
        ("kind: ssh\n", "kind: ssh needs hosts"),
        ("kind: local\nqueue: short\n", "kind: local takes no queue"),
        ("kind: pbs\nmemory: 8 GiB\nhosts: [a]\n", "kind: pbs takes no hosts"),
        ("kind: local\nthread: 2\n", "c.yaml:2: key 'thread' is unknown: did you mean 'threads'?"),
        ("workers: 2\n", "the cluster lacks 'kind'"),
        ("kind: local\nworkers: 0\n", "expected a number at least 1"),
        ("kind: local\nmemory: 8\n", "an amount of memory with its unit"),
        ("- local\n", "found a list, expected a mapping"),
    ],
)
def test_what_is_wrong_is_named(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(CmsReduceError) as found:
        load_cluster(path)
    assert said in str(found.value)


def test_a_file_that_is_missing_is_told_from_an_address(tmp_path: Path) -> None:
    with pytest.raises(CmsReduceError, match=r"No such file.*tcp://node1:8786"):
        load_cluster(tmp_path / "none.yaml")
