"""A thousand random scenes of every mode set against dense models made from the geometry alone.

Exit code 1 if one deviates; a scene that is refused with a message is counted apart.
``--scenes 200`` runs fewer, ``--first 1000`` others.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The generator lives with the tests, which are not installed.
sys.path.insert(0, str(ROOT))

from tests.hard.random_scenes.compared import faults  # noqa: E402


def main() -> int:
    """Run the scenes; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    started, wrong, refused = time.perf_counter(), 0, 0
    for seed in range(given.first, given.first + given.scenes):
        with tempfile.TemporaryDirectory() as folder:
            found = faults(seed, Path(folder))
        said_no = any(": refused: " in line for line in found)
        refused += said_no
        wrong += bool(found) and not said_no
        for line in found:
            print(line, flush=True)
    print(f"{given.scenes} scenes, {wrong} wrong, {refused} refused, {time.perf_counter() - started:.0f} s")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
