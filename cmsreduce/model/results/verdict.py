"""Verdict of a run: one word, the limits that decide it, and what was proven of its bodies or taken on trust."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from cmsreduce.model.results.errors import Finding

__all__ = ["PROOFS", "Proof", "State", "Verdict", "Word", "judge"]

Word = Literal["PASS", "FAIL", "not checked"]
"""``not checked`` is the verdict of a run that sets no limit."""

State = Literal["proven", "trusted", "unproven", "refuted"]
"""``trusted``: the user vouches for it; ``unproven``: the files do not say enough to prove it."""

PROOFS: Mapping[str, str] = {
    "row order": "the rows of the matrices are the dofs that the files name",
    "stiffness": "K is symmetric, has no negative energy, and agrees with the deck where it states materials",
    "mass": "M is symmetric, has no negative energy, has the rows of K, and the mass and inertia of one body",
    "damping": "D takes energy from every motion and none from a rigid one",
    "rigid motions": "K resists every motion but the rigid ones",
    "mode count": "no mode below the cutoff is missing",
    "stability": "every root of the assembled reduced system decays or stands still",
}
"""Facts to prove of each body, and of the assembled system, before its errors count."""


@dataclass(frozen=True)
class Proof:
    """One thing that the verdict rests on.

    Parameters
    ----------
    what : str
        Key of `PROOFS`.
    state : str
        ``proven``, ``trusted``, ``unproven`` or ``refuted``.
    digits : float, optional
        Decimal digits to which it is proven: -log10 of the relative difference that would have been found.
    remark : str
        Method of the proof, or the reason why there is none.
    subject : str
        Component; empty for the assembled system.
    only : str
        Part of it that is proven, such as the ``order`` of a mass whose amount nothing states, or the ``stretch`` of
        plates whose bending is not compared; empty if all of it is.
    """

    what: str
    state: State
    digits: float | None = None
    remark: str = ""
    subject: str = ""
    only: str = ""

    @property
    def label(self) -> str:
        """The fact by name, or the part of it that is proven."""
        return f"{self.what} ({self.only} alone)" if self.only else self.what


@dataclass(frozen=True)
class Verdict:
    """Verdict of a run, the same for every command and file that states it.

    Parameters
    ----------
    word : str
        ``PASS`` if all limits are measured and met and nothing is refuted; ``not checked`` without any limit.
    broken : tuple of Finding
        Limits that are not met. A limit that was not measured has the value NaN and says why in its note.
    proofs : tuple of Proof
        Body by body, then of the assembled system.
    met : tuple of Finding
        Limits that are measured and met.
    """

    word: Word
    broken: tuple[Finding, ...] = ()
    proofs: tuple[Proof, ...] = ()
    met: tuple[Finding, ...] = ()

    @property
    def passed(self) -> bool:
        """True for ``PASS`` alone."""
        return self.word == "PASS"

    @property
    def unmeasured(self) -> tuple[Finding, ...]:
        """Broken limits without a value."""
        return tuple(finding for finding in self.broken if math.isnan(finding.value))

    @property
    def proven(self) -> tuple[Proof, ...]:
        """Proven facts."""
        return tuple(proof for proof in self.proofs if proof.state == "proven")

    @property
    def refuted(self) -> tuple[Proof, ...]:
        """Facts that were found false."""
        return tuple(proof for proof in self.proofs if proof.state == "refuted")

    @property
    def trusted(self) -> tuple[Proof, ...]:
        """Proofs replaced by the word of the user."""
        return tuple(proof for proof in self.proofs if proof.state == "trusted")

    @property
    def unproven(self) -> tuple[Proof, ...]:
        """Proofs that the files do not allow."""
        return tuple(proof for proof in self.proofs if proof.state == "unproven")


def judge(findings: Iterable[Finding], proofs: Iterable[Proof], *, limited: bool) -> Verdict:
    """Judge a run.

    Parameters
    ----------
    findings : iterable of Finding
        Errors and checks with their limits; a limit that could not be measured is a finding of value NaN.
    proofs : iterable of Proof
        Of the bodies and of the system.
    limited : bool
        True if the run sets a limit on an error of its model.
    """
    proofs, judged = tuple(proofs), [finding for finding in findings if finding.judged]
    broken, met = (tuple(finding for finding in judged if finding.passed is passed) for passed in (False, True))
    if broken or any(proof.state == "refuted" for proof in proofs):
        return Verdict("FAIL", broken, proofs, met)
    return Verdict("PASS" if limited else "not checked", broken, proofs, met)
