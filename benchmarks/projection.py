"""Component modes ranked and cut off, against system modes projected and reassembled.

Prints the table of benchmarks/projection.md; ``--write`` puts it there.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.errors import CmsReduceError  # noqa: E402
from cmsreduce.pipeline.run import Run  # noqa: E402
from cmsreduce.pipeline.store import Silent  # noqa: E402
from cmsreduce.pipeline.system import midpoint_configurations  # noqa: E402

PAGE = ROOT / "benchmarks" / "projection.md"
START, END = "<!-- table -->", "<!-- end of table -->"
HEADER = (
    "| scene | asked | road | elastic modes | error at sampled angles | at midpoints | seconds |\n"
    "|---|---|---|---|---|---|---|"
)
ROADS = {
    "component modes, ranked": ["balance.keep={{frf_error: {error}}}"],
    "system modes of all angles": ["balance.keep=all", "project={{modes: auto, frf_error: {error}, between: false}}"],
    "system modes, angles added as needed": [
        "balance.keep=all",
        "project={{modes: auto, configurations: auto, frf_error: {error}}}",
    ],
    "both: ranked, then projected": [
        "balance.keep={{frf_error: {half}}}",
        "project={{modes: auto, frf_error: {error}, between: false}}",
    ],
}
ERRORS = (0.05, 0.02, 0.01)
SCENES = ("galileo", "station")


def rows(scene: str) -> Iterator[str]:
    """Lines of one scene."""
    for error in ERRORS:
        for road, overrides in ROADS.items():
            given = [text.format(error=error, half=error / 2) for text in overrides]
            with tempfile.TemporaryDirectory() as folder:
                yield f"| {scene} | {error:.0%} | {road} | {measured(scene, given, Path(folder))} |"


def measured(scene: str, overrides: list[str], folder: Path) -> str:
    """Modes, errors and time of one method, or the reason for no result."""
    pipeline = load_pipeline(ROOT / "pipelines" / f"{scene}.yaml", overrides)
    run = Run(pipeline, folder, Silent())
    # The full system and the bodies' modes are common to all roads.
    modes, comparison = run.ranked, run.comparison
    del modes
    started = time.perf_counter()
    try:
        final = run.final
    except CmsReduceError as error:
        return f"refused: {str(error).split(':')[-1].split('.')[0].strip()} | | | "
    seconds = time.perf_counter() - started
    kept = sum(component.elastic_count for component in final.values())
    at, between = (
        max((comparison.error_at(setting, run.model) for setting in settings), default=float("nan"))
        for settings in (run.scene.configurations, midpoint_configurations(run.scene))
    )
    return f"{kept} | {at:.2%} | {between:.2%} | {seconds:.1f}"


def main(arguments: list[str]) -> None:
    """Print the table, or write it into its page."""
    scenes = [name for name in SCENES if (ROOT / "pipelines" / f"{name}.yaml").is_file()]
    lines = [HEADER]
    print(HEADER)
    for scene in scenes:
        for line in rows(scene):
            print(line, flush=True)
            lines.append(line)
    if "--write" in arguments:
        text = PAGE.read_text(encoding="utf-8")
        before, _, rest = text.partition(START)
        _, _, after = rest.partition(END)
        PAGE.write_text(before + START + "\n\n" + "\n".join(lines) + "\n\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
