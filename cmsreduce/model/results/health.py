"""The health of a body before its reduction: one table for summary.json, the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

__all__ = ["HealthFinding", "health_data"]

# A section that was not measured has one of these values.
_SECTIONS: dict[str, type | None] = {
    "mass_properties": dict,
    "principal": None,
    "rigid_motions": None,
    "grounding": None,
    "massless": None,
    "nearly_massless": None,
    "highest_dof": None,
    "stiffness_contrast": list,
    "negative_motions": dict,
    "frequency_error_bar": None,
}


@dataclass(frozen=True)
class HealthFinding:
    """One measured quantity of a body.

    Parameters
    ----------
    key : tuple of str
        Place below ``health`` in summary.json; a section that is a list collects the values of its findings.
    name : str
        Quantity in words.
    value : object
        Plain value, as it stands in summary.json.
    words : str
        The value with its unit, for a reader.
    judged, limit : float, optional
        The number that is compared with the limit, and the largest that passes; NaN does not pass.
    advice : str
        Consequence of a limit that is not met.
    """

    key: tuple[str, ...]
    name: str
    value: Any
    words: str
    judged: float = 0.0
    limit: float | None = None
    advice: str = ""

    @property
    def passed(self) -> bool:
        """True if the limit is met or there is none."""
        return self.limit is None or bool(self.judged <= self.limit)


def health_data(table: Iterable[HealthFinding]) -> dict[str, Any]:
    """The values of a table, nested as in summary.json."""
    data: dict[str, Any] = {section: kind and kind() for section, kind in _SECTIONS.items()}
    for finding in table:
        place, (*above, last) = data, finding.key
        for word in above:
            place[word] = place.get(word) or {}
            place = place[word]
        if isinstance(place.get(last), list):
            place[last].append(finding.value)
        else:
            place[last] = finding.value
    return data
