"""Proofs of a body by itself, or beside its deck."""

from __future__ import annotations

from pathlib import Path

from cmsreduce.model import FEModel, Proof
from cmsreduce.pipeline.bodies.mass_proof import negative_mass, prove_mass
from cmsreduce.pipeline.bodies.stiffness_proof import negative_stiffness, prove_stiffness
from cmsreduce.pipeline.evidence import evidence_of, statement_of
from cmsreduce.read import prove_row_order

__all__ = ["proofs_of"]


def proofs_of(body: FEModel, deck: Path | None = None) -> dict[str, Proof]:
    """Proofs of its rows, its stiffness and its mass."""
    stated = (None, None) if deck is None else statement_of(deck, body)
    evidence = evidence_of(body, prove_row_order(body), stated)
    proofs = prove_stiffness(body, evidence, negative_stiffness(body))[1]
    mass = prove_mass(body, body, evidence, negative_mass(body))[1]
    return {each.what: each for each in (*proofs, mass)}
