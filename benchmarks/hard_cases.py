"""Hard cases through every mode set: the difficulty, the treatment, error against time.

Prints benchmarks/hard-cases.md; ``--write`` puts it there.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The cases live with the tests, which are not installed.
sys.path.insert(0, str(ROOT))

from cmsreduce.errors import CmsReduceError  # noqa: E402
from tests.hard.case import METHODS, Case  # noqa: E402
from tests.hard.cases import BUILDERS, build  # noqa: E402
from tests.hard.outcome import outcome, reduce  # noqa: E402

INTRODUCTION = """\
# Hard cases

Bodies on which textbook code fails, each reduced by every mode set with normal modes to twice the band (`tests/hard/`).
`python benchmarks/hard_cases.py --write` prints this page. The reference of every figure is the unreduced body, solved
directly by scipy.

- **frf_error**: response error over the band at 1 % of critical damping, without the rigid part. The body is joined to
  the neighbour that loads it; inputs and outputs are its interface, loads and sensors.
- **Limit**: what theory allows on this body. Craig-Bampton: 1.5 times the first-order shift of frequencies by the
  fixed-interface modes left out, plus 0.01. MacNeal-Rubin: 0.01. Benfield-Hruda, and augmented-body modes where the
  neighbour adds no stiffness: the error of modal truncation of the joined bodies, plus 0.001. Guyan, and augmented-body
  modes beside a stiff neighbour: no limit, because theory has none.
- **Static**: share of the strain energy of static responses that the basis misses, worst load. Sets with constraint
  modes: loads that balance on the interface. MacNeal-Rubin: all loads, inertia relieved.
- **K**: worst phi_i^T K phi_j / (w_i w_j) of two modes, in long double; **M** likewise. Bodies whose own numbers cancel
  (stiffness contrast, a slender mast) have the tolerance of a strain energy in double precision.
- **s**: seconds to reduce and orthogonalise, on one core.
"""
HEADER = "| mode set | columns | frf_error | limit | static | K | M | s |\n|---|---|---|---|---|---|---|---|"


def page() -> Iterator[str]:
    """Lines of the page."""
    yield INTRODUCTION
    for name in BUILDERS:
        case = build(name)
        rigid = "no rigid motion" if not case.rigid.shape[1] else f"{case.rigid.shape[1]} rigid motions"
        yield f"## {case.name[0].upper()}{case.name[1:]}\n"
        yield textwrap.fill(f"{case.hard} {case.treated}", 120, break_on_hyphens=False) + "\n"
        low, high = case.band_hz
        yield f"{case.body.n} dofs, {case.interface.size} of them interface, {rigid}, {low:g} to {high:g} Hz.\n"
        yield HEADER
        for method in METHODS:
            yield row(case, method)
        yield ""


def row(case: Case, method: str) -> str:
    """One mode set on one case."""
    if method in case.refused:
        try:
            reduce(case, method)
        except CmsReduceError as error:
            return f"| {method} | refused: {type(error).__name__} | | | | | | |"
        raise AssertionError(f"{case.name}: {method} was not refused")
    found = outcome(case, method)
    figures = [
        str(found.columns),
        f"{found.error:.1e}",
        "" if found.limit is None else f"{found.limit:.1e}",
        "" if found.completeness is None else f"{found.completeness:.0e}",
        f"{found.stiffness:.0e}",
        f"{found.mass:.0e}",
        f"{found.seconds:.2f}",
    ]
    return f"| {method} | {' | '.join(figures)} |"


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        lines = "\n".join(page()).rstrip() + "\n"
        (ROOT / "benchmarks" / "hard-cases.md").write_text(lines, encoding="utf-8")
    else:
        for line in page():
            print(line, flush=True)
