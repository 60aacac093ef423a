"""Which constraint sets the case control of a deck selects."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = ["selected_set"]

_SUBCASE = re.compile(r"SUBCASE\b|SUBCOM\b|SYM\b", re.IGNORECASE)


def selected_set(lines: Sequence[str], keyword: str) -> tuple[int | None, str | None]:
    """Set number that SPC or MPC selects, and a remark if subcases differ.

    A selection above the subcases holds for all of them; a subcase may replace it. The first subcase counts.

    Parameters
    ----------
    lines : sequence of str
        Case control, upper case.
    keyword : str
        ``SPC`` or ``MPC``.

    Returns
    -------
    number : int or None
        None if nothing is selected, so that no such card is in force.
    remark : str or None
        Set where later subcases select another set.

    Examples
    --------
    >>> selected_set(["SPC = 3", "SUBCASE 1", "SPC = 5", "SUBCASE 2"], "SPC")
    (5, 'subcases select different SPC sets (5, 3): the first is taken')
    """
    pattern = re.compile(rf"{keyword}\s*=\s*(\d+)")
    above: int | None = None
    cases: list[int | None] = []
    for line in lines:
        if _SUBCASE.match(line):
            cases.append(above)
            continue
        found = pattern.match(line)
        if found and cases:
            cases[-1] = int(found[1])
        elif found:
            above = int(found[1])
    if not cases:
        return above, None
    distinct = list(dict.fromkeys(cases))
    if len(distinct) == 1:
        return distinct[0], None
    listed = ", ".join("none" if number is None else str(number) for number in distinct)
    return cases[0], f"subcases select different {keyword} sets ({listed}): the first is taken"
