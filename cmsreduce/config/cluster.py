"""The grammar of a cluster file, which states where the processes of a sweep run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from cmsreduce.config.keys import Count, Keys, Memory
from cmsreduce.config.located import parse, plain
from cmsreduce.config.problems import config_error, problems_of, refuse_empty
from cmsreduce.errors import ReadError, refuse_device

__all__ = ["ClusterKeys", "load_cluster"]

_QUEUED = ("queue", "account", "walltime", "prologue", "directives")
_OVER_SSH = ("hosts", "python")
_Some = Annotated[Count, Field(ge=1)]


class ClusterKeys(Keys):
    """Processes of a sweep: their number, machines and resources."""

    kind: Literal["local", "slurm", "pbs", "ssh"] = Field(
        description="local: this machine. slurm, pbs: one job of the queueing system for each process. ssh: machines "
        "with login without a password.",
        examples=["slurm"],
    )
    workers: _Some = Field(default=1, description="Processes; each runs one task at a time.", examples=[8])
    threads: _Some = Field(default=1, description="Cores of each process.", examples=[4])
    memory: Memory | None = Field(default=None, description="Memory of each process.", examples=["16 GiB"])
    queue: str | None = Field(default=None, description="Queue or partition of the jobs.", examples=["short"])
    account: str | None = Field(default=None, description="Account of the jobs.", examples=["structures"])
    walltime: str | None = Field(default=None, description="Longest time of a job, hh:mm:ss.", examples=["04:00:00"])
    prologue: list[str] | None = Field(
        default=None,
        description="Shell lines that run before the process, for instance to load a module.",
        examples=[["module load python/3.11"]],
    )
    directives: list[str] | None = Field(
        default=None, description="More header lines of a job.", examples=[["--exclusive"]]
    )
    hosts: list[str] | None = Field(
        default=None, min_length=1, description="Machines; the scheduler runs on the first.", examples=[["node1"]]
    )
    python: str | None = Field(
        default=None,
        description="Python interpreter with cmsreduce on these machines.",
        examples=["/opt/cms/bin/python"],
    )

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> ClusterKeys:
        queued = self.kind in ("slurm", "pbs")
        strange = [key for key in (() if queued else _QUEUED) if getattr(self, key) is not None]
        strange += [key for key in (() if self.kind == "ssh" else _OVER_SSH) if getattr(self, key) is not None]
        if strange:
            raise ValueError(f"kind: {self.kind} takes no {' and no '.join(strange)}")
        if queued and self.memory is None:
            raise ValueError(f"kind: {self.kind} needs memory, e.g. memory: 16 GiB: a job gets only what it asks for")
        if self.kind == "ssh" and self.hosts is None:
            raise ValueError("kind: ssh needs hosts, e.g. hosts: [node1, node2]")
        return self


def load_cluster(path: Path) -> ClusterKeys:
    """Read and check a cluster file.

    Raises
    ------
    ReadError
        If there is no such file.
    ConfigError
        One line for each error: file, line, key.
    """
    refuse_device(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ReadError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}); --cluster takes a file such as "
            "configs/cluster-slurm.yaml, or the address of a Dask scheduler such as tcp://node1:8786"
        ) from None
    root = parse(text, str(path), path.parent)
    refuse_empty(root, ClusterKeys)
    try:
        return ClusterKeys.model_validate(plain(root))
    except ValidationError as error:
        raise config_error(problems_of(root, error.errors(include_url=False), ClusterKeys, "the cluster")) from None
