"""Stages of a run up to its bodies as read and proven, each by one process and once for all runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import Pipeline, build_scene
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.machine import SolverSettings, available_memory
from cmsreduce.model import Configuration, FEModel, RigidBody, Scene
from cmsreduce.pipeline.bodies import (
    WRITTEN_LIMIT,
    FlexibleBody,
    ProvenBody,
    copy_of,
    in_scene,
    needs_files,
    proven_body,
    read_rigid,
)
from cmsreduce.pipeline.run.keys import absolute_files, body_key, contents, file_size, proof_key, read_key
from cmsreduce.pipeline.store import (
    CommonWork,
    Failures,
    Progress,
    Stages,
    at_once,
    collecting,
    once,
    report_failures,
    stage,
)
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.read import refuse_rewritten

__all__ = ["HELD", "ReadStages"]

HELD = 16
"""Sets of bodies as read and of references that points of a sweep hold together: those before and after a change."""

# Bytes of the files of a body above which the algebra of one body keeps all cores busy.
_LARGE = 2**27
# Memory that work on a body takes, in bytes of its files: twice what bodies of solids in scipy files were seen to take.
_GROWTH = 20


class _Given(Mapping[str, Mapping[str, object]]):
    """Bodies and configurations of a run, collected when a stored result refers to one."""

    def __init__(self, run: ReadStages) -> None:
        self._run = run

    def __getitem__(self, kind: str) -> Mapping[str, object]:
        if kind == FEModel.__name__:
            return {name: flexible.body for name, flexible in self._run.bodies.items()}
        return {each.name: each for each in self._run.scene.configurations}

    def __iter__(self) -> Iterator[str]:
        return iter((FEModel.__name__, Configuration.__name__))

    def __len__(self) -> int:
        return 2


class ReadStages:
    """Stages of a run up to the bodies as read and proven.

    Parameters
    ----------
    pipeline : Pipeline
        The pipeline file, validated.
    folder : Path
        Run directory.
    progress : Progress
        Listener.
    only : str, optional
        The one stage to run; those before it must be finished.
    common : CommonWork, optional
        Work shared with other runs of this process, such as other points of a sweep.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        folder: Path,
        progress: Progress,
        only: str | None = None,
        common: CommonWork | None = None,
    ) -> None:
        self.pipeline, self.folder = pipeline, folder
        self.keyed: Pipeline = absolute_files(pipeline)
        self.stages = Stages(folder, progress, only, SolverSettings(**pipeline.solver.model_dump()), common)
        self.scene: Scene = build_scene(pipeline)
        self.rigid_bodies: dict[str, RigidBody] = {
            name: read_rigid(pipeline, name, self.scene)
            for name, part in pipeline.components.items()
            if part.rigid is not None
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.pipeline.name} in {self.folder}>"

    @property
    def flexible_names(self) -> list[str]:
        """Flexible bodies."""
        return [name for name, part in self.pipeline.components.items() if part.rigid is None]

    @property
    def reduced_names(self) -> list[str]:
        """Flexible bodies that are reduced; the others enter the system as they were read."""
        return [name for name in self.flexible_names if self.pipeline.reduce_of(name) is not None]

    @stage(
        "read",
        key=lambda run, name: run.proof_key(name),
        stored=lambda run, name: not needs_files(run.pipeline, name),
        again=lambda run, found, name: found.outdated,
        needed=True,
    )
    def _proven(self, name: str) -> ProvenBody:
        with collecting(Failures(log=self.stages.failures.log)) as failed:
            found = proven_body(self.pipeline, name, self.scene)
        # A proof is never kept under the key of other files.
        refuse_rewritten(self._contents(name))
        return replace(found, failures=tuple(failed))

    @stage(
        "",
        key=lambda run, name: read_key(run.keyed, name),
        notes=lambda run, found, name: found.notes,
        stored="never",
        common=HELD,
    )
    def flexible(self, name: str) -> FlexibleBody:
        """Read one flexible body and check it; a copy of an earlier one takes what was read and proven there."""
        original = next(each for each in self.flexible_names if self.body_key(each) == self.body_key(name))
        if original != name:
            return copy_of(self.flexible(original), self.pipeline, name, self.scene)
        proven = self._proven(name)
        report_failures(proven.failures)
        return in_scene(proven, self.pipeline, name, self.scene)

    def read_bodies(self) -> None:
        """Read all flexible bodies and check them, small ones several at a time."""
        firsts = {self.body_key(name): name for name in self.flexible_names[::-1]}
        self._at_once(self._proven, [name for name in self.flexible_names if name in firsts.values()])
        for name in self.flexible_names:
            self.flexible(name)

    @property
    def files_read(self) -> list[Path]:
        """Files that the bodies were read from, those that their decks include among them."""
        firsts = {self.body_key(name): name for name in self.flexible_names[::-1]}
        return [Path(path) for name in firsts.values() for path in self._proven(name).files]

    def _at_once(self, work: Callable[[str], object], names: Sequence[str]) -> None:
        """Do a piece of work on small bodies, several at a time; the run holds the results.

        Much of the work on one body takes one thread: two bodies of 85 000 dofs at once take a quarter less time, of
        295 000 dofs no less, and half as much memory again. What is left is for the caller to do body by body: large
        ones, one that would have no other beside it, and all of them where the pipeline states a number of threads,
        where processes share the bodies, where memory is short, and with MUMPS, whose processes take one order at once.
        """
        solver = self.stages.solver
        if solver.threads is not None or solver.backend == "mumps" or self.stages.common is not None:
            return
        bytes_of = {name: file_size(self.pipeline, name) for name in names}
        small = [name for name in names if bytes_of[name] <= _LARGE]
        threads = solver.thread_count
        last = len(small) - len(small) % threads
        for some in (small[:last], small[last:]):
            count = min(threads, len(some))
            largest = sorted(bytes_of[name] for name in some)[len(some) - count :]
            if count > 1 and _GROWTH * sum(largest) <= available_memory():
                at_once(self.stages, work, some, count)

    @once
    def proof_key(self, name: str) -> str:
        """Hash of all that a body as read and proven depends on."""
        return proof_key(self.keyed, name, self._contents(name))

    @once
    def _contents(self, name: str) -> dict[Path, str]:
        """Hashes of the files that a body is read from, when this run first looked at them."""
        return contents(self.keyed, name)

    @once
    def body_key(self, name: str) -> str:
        """Hash of the keys that say which body a component is."""
        return body_key(self.keyed, name)

    @property
    @once
    def bodies(self) -> dict[str, FlexibleBody]:
        """Flexible bodies, read and checked; joints, actuators and sensors are wired to them as a check."""
        for name in self.at_hand(self.flexible_names):
            self.flexible(name)
        found = {}
        for name in self.flexible_names:
            found[name] = self.flexible(name)
            self._refuse_unwritable(found[name].body)
            # Checked before anything is reduced, so that a faulty body shows in the results.
            _ = found[name].health
        model = self._in_dofs(found)
        for configuration in self.scene.configurations:
            for note in model.wiring(configuration).notes:
                self.stages.note(note)
        return found

    def at_hand(self, names: Sequence[str]) -> Iterator[str]:
        """Names of bodies in this order; those that another process is at work on come last."""
        waiting = [*names]
        while waiting:
            claimed = (self.stages.store.is_claimed("read", name, self.proof_key(name)) for name in waiting)
            yield waiting.pop(next((k for k, busy in enumerate(claimed) if not busy), 0))

    def has_proven(self, name: str) -> bool:
        """True if this process has read and proven a body, whose factor may still be in its memory."""
        return self.stages.store.path("read", name, self.proof_key(name)) in self.stages.written

    def _in_dofs(self, bodies: Mapping[str, FlexibleBody]) -> AssembledModel:
        bare = {name: replace(each, body=each.undamped).substructure(self.scene) for name, each in bodies.items()}
        rigid = {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        return AssembledModel({name: (bare | rigid)[name] for name in self.pipeline.components}, self.scene)

    @property
    @once
    def in_dofs(self) -> AssembledModel:
        """The unreduced bodies in their dofs, joined, without their damping."""
        return self._in_dofs(self.bodies)

    def _refuse_unwritable(self, body: FEModel) -> None:
        """Refuse files of an unreduced body that is too large for all its modes, before anything is computed."""
        if self.pipeline.write is None or self.pipeline.reduce_of(body.name) or body.n <= WRITTEN_LIMIT:
            return
        raise ConfigError(
            f"component '{body.name}': `write.formats` asks for its files, but it has no `reduce:`, and its {body.n} "
            f"dofs are too many to write it in all its modes (at most {WRITTEN_LIMIT}). Give it "
            f"`components.{body.name}.reduce`, or take `write:` out"
        )

    @property
    def given(self) -> Mapping[str, Mapping[str, object]]:
        """Bodies and configurations, which stored results refer to by name."""
        return _Given(self)
