"""Speed against error: the Galileo sample at growing size.

Prints a Markdown table; every time stands beside an error, every comparison is a ratio within one run.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, run_result

ROOT = Path(__file__).parents[1]
COUNTS = ((4, 4), (8, 8), (12, 10), (19, 15), (30, 16), (74, 16))


def galileo() -> None:
    """Worst error over eight configurations against modes kept and time of the responses."""
    print("| rotor + stator modes | frf_error | db_error | full response, s | reduced, s | ratio |")
    print("|---|---|---|---|---|---|")
    for rotor, stator in COUNTS:
        keep = f"balance.keep={{modes: {{rotor: {rotor}, stator: {stator}}}}}"
        pipeline = load_pipeline(ROOT / "pipelines" / "galileo.yaml", [keep, "verify.compare={}"])
        with tempfile.TemporaryDirectory() as folder:
            result = run_result(Run(pipeline, Path(folder), Silent()))
        worst, speed = result.worst(), result.speed
        assert speed is not None
        print(
            f"| {rotor} + {stator} | {100 * worst['frf_error']:.3g} % | {worst['db_error']:.3g} dB "
            f"| {speed.full_frf_s:.2f} | {speed.reduced_frf_s:.2f} | {speed.full_frf_s / speed.reduced_frf_s:.1f} |"
        )


if __name__ == "__main__":
    galileo()
