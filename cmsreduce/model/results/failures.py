"""Parts of a run that failed alone: what was left out, why, and which limits depended on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from cmsreduce.model.results.errors import Finding

__all__ = ["Failure", "failure_findings"]


@dataclass(frozen=True)
class Failure:
    """A diagnostic, a comparison, a picture or a file that failed, while the run went on.

    Parameters
    ----------
    what : str
        In words: ``the drawing of 'rotor'``.
    reason : str
        Message of the error, on one line.
    required : bool
        True if the pipeline asks for it by name, or if every body must pass it: the run fails.
    limits : tuple of str
        Limits that were not measured because of it.
    error : str
        Class of the error.
    """

    what: str
    reason: str
    required: bool = False
    limits: tuple[str, ...] = ()
    error: str = ""

    @property
    def line(self) -> str:
        """One line for a reader.

        Examples
        --------
        >>> Failure("the drawing of 'rotor'", "no element is known").line
        "the drawing of 'rotor' had to be left out: no element is known"
        """
        return f"{self.what} had to be left out: {self.reason}"


def failure_findings(
    failures: Iterable[Failure], limits: Mapping[str, float], found: Mapping[str, Finding]
) -> Iterator[Finding]:
    """Findings of failures that break a run: parts that are required, and limits that were not measured.

    Parameters
    ----------
    failures : iterable of Failure
        All failures of a run.
    limits : mapping of str to float
        Limits that the run sets.
    found : mapping of str to Finding
        Findings of the run by name; one that already says that it was not measured is not repeated.
    """
    for failure in failures:
        if failure.required:
            yield Finding(failure.what, math.nan, 0.0, f"left out: {failure.reason}")
        for name in failure.limits:
            if name in limits and not (name in found and math.isnan(found[name].value)):
                yield Finding(name, math.nan, limits[name], f"not measured: {failure.reason}")
