"""Processes of a Dask cluster that runs already, or that is started for the work."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from cmsreduce.config import ClusterKeys, load_cluster
from cmsreduce.errors import ConfigError
from cmsreduce.pipeline.batch.workers import Workers, local_workers
from cmsreduce.pipeline.store import code_version

__all__ = ["batch_cluster", "chosen_workers", "cluster_workers"]

_SCHEMES = ("tcp://", "tls://", "ucx://", "ws://", "wss://")
# Seconds to wait for the answer of a scheduler, and for the first of its processes.
_ANSWER, _FIRST = 20, 3600
# Seconds after which a job ends that finds no scheduler.
_PATIENCE = 120
# The scheduler's own page takes any free port: two sweeps may run on one machine.
_ANY_PORT = ":0"
# Environment of the processes. Dask's own one also tells the allocator to return all memory at once, and fixes its
# thresholds by that: a sweep then spends a third of its time on pages that it gives back and takes again.
_ENVIRONMENT = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1)
# Share of the memory of a process that a factor may take; the rest is for the basis.
_SHARE = 0.9


def chosen_workers(jobs: int, cluster: str | None, needed: Path) -> AbstractContextManager[Workers]:
    """Processes of this machine, or of a cluster if one is named."""
    return nullcontext(local_workers(jobs)) if cluster is None else cluster_workers(cluster, needed.resolve())


@contextmanager
def cluster_workers(where: str, needed: Path) -> Iterator[Workers]:
    """Processes of a cluster while the block lasts.

    Parameters
    ----------
    where : str
        Address of a scheduler, ``tcp://node1:8786``, or a cluster file (`load_cluster`).
    needed : Path
        A file that every process must see under the same name; so must it see the folder of the results.

    Raises
    ------
    ConfigError
        If dask is not installed, the scheduler does not answer, or a process runs other code or sees other files.
    """
    try:
        from distributed import Client, KilledWorker
    except ModuleNotFoundError:
        raise ConfigError("--cluster needs dask: pip install 'cmsreduce[dask]'") from None
    address = where.startswith(_SCHEMES)
    keys = None if address else load_cluster(Path(where))
    logging.getLogger("distributed").setLevel(logging.ERROR)
    with nullcontext(where) if keys is None else _started(keys) as cluster:
        try:
            client = Client(cluster, timeout=_ANSWER, set_as_default=False)
        except OSError as error:
            raise ConfigError(
                f"--cluster {where}: no scheduler answers there ({' '.join(str(error).split())})"
            ) from None
        with client:
            client.wait_for_workers(1, timeout=_FIRST if keys is not None else _ANSWER)
            _check(client, where, needed)
            count, memory = _size(client, keys)
            threads = 0 if keys is None else keys.threads
            # Dask takes tasks for pure by default, and would return an old result.
            executor = client.get_executor(pure=False)
            yield Workers(count, threads, memory, lambda jobs: nullcontext(executor), (KilledWorker,))


def batch_cluster(keys: ClusterKeys) -> Any:
    """Jobs of a queueing system that become processes of a cluster; not yet submitted.

    Parameters
    ----------
    keys : ClusterKeys
        Keys of kind slurm or pbs.

    Raises
    ------
    ConfigError
        If dask-jobqueue is not installed.
    """
    try:
        from dask_jobqueue import PBSCluster, SLURMCluster
    except ModuleNotFoundError:
        raise ConfigError(f"kind: {keys.kind} needs dask-jobqueue: pip install 'cmsreduce[dask]'") from None
    memory = math.ceil((keys.memory or 0.0) / 2**20)
    shared = {
        # One task at a time: the task sets the number of its threads, not dask.
        "cores": 1,
        "memory": f"{memory} MiB",
        "queue": keys.queue,
        "account": keys.account,
        "walltime": keys.walltime or "01:00:00",
        "job_script_prologue": keys.prologue or [],
        "job_extra_directives": keys.directives or [],
        "death_timeout": _PATIENCE,
        "scheduler_options": {"dashboard_address": _ANY_PORT},
    }
    if keys.kind == "slurm":
        return SLURMCluster(job_cpu=keys.threads, job_mem=f"{memory}M", **shared)
    return PBSCluster(resource_spec=f"select=1:ncpus={keys.threads}:mem={memory}mb", **shared)


@contextmanager
def _started(keys: ClusterKeys) -> Iterator[Any]:
    import dask.config

    with dask.config.set({"distributed.nanny.pre-spawn-environ": _ENVIRONMENT}), _cluster(keys) as cluster:
        yield cluster


def _cluster(keys: ClusterKeys) -> Any:
    from distributed import LocalCluster, SSHCluster

    memory = None if keys.memory is None else int(keys.memory)
    if keys.kind == "local":
        limit = {} if memory is None else {"memory_limit": memory}
        return LocalCluster(n_workers=keys.workers, threads_per_worker=1, dashboard_address=_ANY_PORT, **limit)
    if keys.kind == "ssh":
        hosts = keys.hosts or []
        options: dict[str, Any] = {"nthreads": 1, "n_workers": math.ceil(keys.workers / len(hosts))}
        if memory is not None:
            options["memory_limit"] = memory
        try:
            return SSHCluster([hosts[0], *hosts], worker_options=options, remote_python=keys.python)
        except (OSError, RuntimeError, ImportError) as error:
            raise ConfigError(f"kind: ssh: the processes cannot be started ({' '.join(str(error).split())})") from None
    cluster = batch_cluster(keys)
    cluster.scale(jobs=keys.workers)
    return cluster


def _check(client: Any, where: str, needed: Path) -> None:
    """Refuse processes that run other code or see other files."""
    own = (code_version("verify"), needed.stat().st_size)
    try:
        seen = client.run(_seen, str(needed))
    except Exception as error:
        # A process in another environment may meet any error when it loads the package; it is sent here as it is.
        raise ConfigError(
            f"--cluster {where}: a process there cannot run cmsreduce ({type(error).__name__}: {error})"
        ) from None
    for address, found in seen.items():
        if found[0] != own[0]:
            raise ConfigError(
                f"--cluster {where}: the process at {address} runs another version of cmsreduce; install the same in "
                "the environment of the cluster"
            )
        if found[1] != own[1]:
            raise ConfigError(
                f"--cluster {where}: the process at {address} does not see {needed}; files are exchanged in a folder "
                "that all machines share under one name"
            )


def _seen(needed: str) -> tuple[str, int]:
    """Version of the code and size of the file as a process sees them."""
    file = Path(needed)
    return code_version("verify"), file.stat().st_size if file.is_file() else -1


def _size(client: Any, keys: ClusterKeys | None) -> tuple[int, float | None]:
    """Number of processes, and the memory that a factor may take in each."""
    # A scheduler counts the processes that it has now; processes of a queue come one by one.
    known = client.scheduler_info(n_workers=-1)["workers"].values()
    limits = [worker["memory_limit"] for worker in known if worker["memory_limit"]]
    count = len(known) if keys is None else keys.workers
    return max(count, 1), _SHARE * min(limits) if limits else None
