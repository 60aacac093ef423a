"""The automatic order on every sample: no ranking, cut anywhere in any body, meets the same error with fewer modes."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.balance import whole_groups
from cmsreduce.config import load_pipeline
from cmsreduce.model import ModalComponent
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.system import system_errors

PIPELINES = Path(__file__).parents[2] / "pipelines"
# Half of the station's modes, so that the search takes a few seconds.
FEW = ("components.inboard.reduce.cutoff=4", "components.outboard.reduce.cutoff=1.5")


def prefixes(component: ModalComponent, ranking: str) -> list[np.ndarray]:
    """The first 0, 1, .. modes by a ranking; those of a repeated frequency come together."""
    groups = sorted(whole_groups(component), key=lambda columns: -component.rankings[ranking][columns].max())
    return [np.sort(np.concatenate([np.empty(0, dtype=np.int64), *groups[:k]])) for k in range(len(groups) + 1)]


@pytest.mark.parametrize(
    ("sample", "asked", "settings", "most"),
    [
        # The last figure is what Gregory's ranking keeps in the pipeline file, or one less than all there are.
        ("galileo", 0.05, ["scene.articulation={spin: [45 deg], cone: [30 deg]}"], 34),
        ("hub_beams", 0.05, [], 18),
        ("station", 0.3, ["scene.articulation={alpha: [45 deg]}", *FEW], 65),
    ],
)
def test_no_truncated_ranking_is_smaller(
    tmp_path: Path, sample: str, asked: float, settings: list[str], most: int
) -> None:
    keys = [f"balance={{keep: {{frf_error: {asked}}}}}", "verify=null", *settings]
    run = Run(load_pipeline(PIPELINES / f"{sample}.yaml", keys), tmp_path, Silent())
    search = run.choice.search
    assert search is not None and search.frf_error <= asked and search.modes <= most
    limits, every = {"frf_error": asked}, list(run.ranked)
    judge, _ = system_errors(run.measure, limits, run.ranked, every, run.joined, between=False)
    for ranking in ("gregory", "hankel", "component-cost"):
        lists = [prefixes(component, ranking) for component in run.ranked.values()]
        fewer = (cut for cut in product(*lists) if sum(columns.size for columns in cut) < search.modes)
        for cut in fewer:
            assert judge.error(dict(zip(run.ranked, cut, strict=True)), 1.0) > 1.0
    # Its time is told where the notes of a run are: on the terminal, in the report, in the summary.
    (note,) = (note for note in run.stages.notes if note.startswith("search"))
    assert note.endswith(f"{search.candidates} candidates") and search.seconds > 0
