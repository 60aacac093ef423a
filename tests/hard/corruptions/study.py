"""The study that the corruptions spoil: two frames of bars and a rigid hub, as matrices, decks and a pipeline."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from ruamel.yaml import YAML

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.store import Silent
from cmsreduce.write import summary
from tests.frames import BAR
from tests.pipeline.study import PIPELINE, arm, panel

__all__ = ["Outcome", "Study", "outcome"]

_BARS = {"arm": [(1, 2), (2, 3), (3, 4), (4, 5)], "panel": [(1, 2), (2, 3), (3, 4), (4, 5), (3, 6)]}
_LUMPS = {"arm": {3: 0.3}, "panel": {}}
_LIMITS = {"frf_error": 0.05, "db_error": 1.0, "frequency_error": 0.01}


@dataclass
class Study:
    """All that a corruption may change: matrices and grids of both bodies, keys, and at last the files.

    ``deck``: the decks state the bars, not the grids alone. ``rows``: labels of the rows, if a file states them.
    """

    deck: bool = True
    K: dict[str, np.ndarray] = field(default_factory=dict)
    M: dict[str, np.ndarray] = field(default_factory=dict)
    D: dict[str, np.ndarray] = field(default_factory=dict)
    xyz: dict[str, np.ndarray] = field(default_factory=dict)
    cards: dict[str, str] = field(default_factory=dict)
    keys: dict[str, Any] = field(default_factory=dict)
    after: list[Callable[[Path], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for body in (arm(), panel()):
            assert body.nodes is not None
            self.K[body.name], self.M[body.name] = body.K.toarray(), body.M.toarray()
            self.xyz[body.name], self.cards[body.name] = body.nodes.xyz.copy(), ""
        keys = YAML(typ="safe").load(io.StringIO(PIPELINE.format(output="out")))
        for name in self.K:
            part = keys["components"][name]
            part["stiffness"], part["mass"] = f"{name}_K.npz", f"{name}_M.npz"
        keys["verify"]["limits"] = dict(_LIMITS)
        # Files are not what the table is about.
        del keys["write"]
        keys["verify"]["checks"] = []
        self.keys = keys

    def damped(self, D: np.ndarray) -> None:
        """Give the arm a damping matrix."""
        self.D["arm"] = D
        self.keys["components"]["arm"]["damping"] = {"matrix": "arm_D.npz"}

    def write(self, folder: Path) -> Path:
        """Write the files, spoil them as asked, and return the pipeline."""
        for name in self.K:
            for letter in ("K", "M", "D"):
                matrix = getattr(self, letter).get(name)
                if matrix is not None:
                    sp.save_npz(folder / f"{name}_{letter}.npz", sp.csc_array(matrix), compressed=False)
            (folder / f"{name}.bdf").write_text(self._deck(name))
        self.keys["output"] = str(folder / "out")
        path = folder / "study.yaml"
        path.write_text(json.dumps(self.keys))
        for change in self.after:
            change(folder)
        return path

    def _deck(self, name: str) -> str:
        lines = ["BEGIN BULK", self.cards[name].rstrip("\n")]
        lines += [
            f"GRID*   {k:16d}{'':16}{x:16.9f}{y:16.9f}\n*       {z:16.9f}"
            for k, (x, y, z) in enumerate(self.xyz[name], start=1)
            if f"GRID,{k}," not in self.cards[name]
        ]
        if self.deck:
            lines += [f"MAT1,1,{BAR.E:.4e},{BAR.G:.4e},,{BAR.rho:.1f}"]
            lines += [f"PBAR,1,1,{BAR.A:.3e},{BAR.Iz:.3e},{BAR.Iy:.3e},{BAR.J:.3e}"]
            for number, (i, j) in enumerate(_BARS[name], start=1):
                x = self.xyz[name][j - 1] - self.xyz[name][i - 1]
                y = np.cross([0.0, 0.0, 1.0], x)
                y /= np.linalg.norm(y)
                lines.append(f"CBAR,{number},1,{i},{j},{y[0]:.5f},{y[1]:.5f},{y[2]:.5f}")
            lines += [f"CONM2,{100 + node},{node},,{mass}" for node, mass in _LUMPS[name].items()]
        return "\n".join(line for line in (*lines, "ENDDATA") if line) + "\n"


@dataclass
class Outcome:
    """Exit code of a run, the first line that says why, and the figures that a user compares."""

    code: int
    line: str
    figures: str

    @property
    def found(self) -> bool:
        """The run was refused or failed, or says that it was not checked."""
        return self.code in (1, 2) or self.line == "not checked"


def outcome(study: Study, folder: Path) -> Outcome:
    """Run a study as the command `run` does, without its report."""
    path = study.write(folder)
    try:
        work = Run(load_pipeline(path, []), folder / "out", Silent())
        result = execute(work, path, report=False)
    except CmsReduceError as error:
        return Outcome(2, " ".join(str(error).replace(f"{folder}/", "").split()), "")
    assert result is not None
    verdict = result.verdict
    refuted = [f"{each.subject}: {each.what}: {each.remark}" for each in verdict.proofs if each.state == "refuted"]
    broken = [f"{each.label} {each.value:.3g}, limit {each.limit:.3g}. {each.note}" for each in verdict.broken]
    line = " ".join([verdict.word, *refuted, *broken][1 if verdict.word == "FAIL" else 0].split())
    return Outcome(int(verdict.word == "FAIL"), line, _figures(summary(result)))


def _figures(facts: dict[str, Any]) -> str:
    """Mass, centre and first elastic frequency of the arm."""
    part = facts["components"]["arm"]
    sources = (part.get("health") or {}).get("mass_properties") or {}
    known = []
    if "geometry" in sources:
        centre = ", ".join(f"{value:.4g}" for value in np.round(sources["geometry"]["centre"], 6) + 0.0)
        known = [f"{max(sources['geometry']['mass']):.4g} kg", f"centre ({centre})"]
    elastic = [hz for hz in part.get("frequencies_hz") or [] if hz > 0]
    return ", ".join([*known, *([f"first mode {elastic[0]:.4g} Hz"] if elastic else [])])
