"""A Dask cluster finds what one process finds; a process that is killed on the way loses nothing."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from multiprocessing import forkserver
from pathlib import Path

import dask
import pytest
from distributed import Client, LocalCluster
from distributed.utils import get_mp_context

from cmsreduce.config import load_cluster
from cmsreduce.errors import ConfigError
from cmsreduce.model import SweepResult
from cmsreduce.pipeline.batch import sweep, sweep_axes
from cmsreduce.pipeline.batch.dask_workers import batch_cluster, cluster_workers
from tests.pipeline.batch.test_sweep import METHODS, ONE_ANGLE, found
from tests.pipeline.rounding import assert_close

OVER = [METHODS, "balance.keep={modes: 4},{modes: 999}", ONE_ANGLE]
CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module", autouse=True)
def quickly_started() -> Iterator[None]:
    """Dask's processes fork off one that has loaded the libraries, which took most of the time of these tests."""
    libraries = ["distributed", "cmsreduce.pipeline.batch.sweep", "pyyeti.nastran"]
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        get_mp_context().set_forkserver_preload(libraries)
        forkserver.ensure_running()
        yield


@pytest.fixture(scope="module")
def alone(good_study: Path, tmp_path_factory: pytest.TempPathFactory) -> SweepResult:
    """The study swept in this process."""
    return sweep(good_study / "study.yaml", sweep_axes(OVER), (), tmp_path_factory.mktemp("alone"))[0]


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as started:
        yield started


def test_a_killed_worker_loses_nothing(
    cluster: LocalCluster, alone: SweepResult, good_study: Path, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill_one() -> None:
        with Client(cluster.scheduler_address, set_as_default=False) as client:
            processes = list(client.run(os.getpid).values())
            while not any(tmp_path.glob("points/*/summary.json")):
                time.sleep(0.02)
            os.kill(processes[0], signal.SIGKILL)
            killed.append(processes[0])

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    path = good_study / "study.yaml"
    result, _ = sweep(path, sweep_axes(OVER), (), tmp_path, cluster=cluster.scheduler_address)
    killer.join(30)
    assert killed
    assert_close(found(result), found(alone))
    assert result.provenance["jobs"] == 2


def test_a_cluster_file_starts_its_processes(alone: SweepResult, good_study: Path, tmp_path: Path) -> None:
    path = good_study / "study.yaml"
    result, _ = sweep(path, sweep_axes(OVER), (), tmp_path, cluster=str(CONFIGS / "cluster-local.yaml"))
    assert_close(found(result), found(alone))
    assert (result.provenance["jobs"], result.provenance["threads"]) == (2, 1)


@pytest.mark.parametrize(
    ("preset", "lines"),
    [
        ("slurm", ["#SBATCH --cpus-per-task=4", "#SBATCH --mem=16384M", "#SBATCH -t 02:00:00"]),
        ("pbs", ["#PBS -l select=1:ncpus=4:mem=16384mb", "#PBS -l walltime=02:00:00"]),
    ],
)
def test_jobs_ask_for_what_the_file_says(preset: str, lines: list[str]) -> None:
    jobs = batch_cluster(load_cluster(CONFIGS / f"cluster-{preset}.yaml"))
    try:
        script = jobs.job_script()
    finally:
        jobs.close()
    assert [line for line in lines if line not in script.splitlines()] == []
    # One task at a time in each; its threads are its own affair.
    assert "--nthreads 1" in script


def test_a_scheduler_that_does_not_answer_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmsreduce.pipeline.batch.dask_workers._ANSWER", 0.5)
    said = r"tcp://127\.0\.0\.1:9: no scheduler answers there"
    with pytest.raises(ConfigError, match=said), cluster_workers("tcp://127.0.0.1:9", tmp_path):
        pass


def test_processes_must_see_the_same_files(
    cluster: LocalCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A folder is no file: to the processes the pipeline is not there.
    with pytest.raises(ConfigError, match="does not see"), cluster_workers(cluster.scheduler_address, tmp_path):
        pass
    monkeypatch.setattr("cmsreduce.pipeline.batch.dask_workers.code_version", lambda stage: "another")
    address, file = cluster.scheduler_address, Path(__file__)
    with pytest.raises(ConfigError, match="another version of cmsreduce"), cluster_workers(address, file):
        pass
