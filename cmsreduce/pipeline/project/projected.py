"""The project stage's findings, as they are and as arrays for the stage store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ExtraneousMode, FEModel, ModalComponent, ModeShare, ProjectionRecord, SampledModes
from cmsreduce.pipeline.store import modal_from, modal_to

__all__ = ["Projected", "projected_from", "projected_to"]

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Projected:
    """Bodies after projection.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Rigid modes, and those that span the body's part of the chosen system modes.
    record : ProjectionRecord
        What was done.
    notes : tuple of str
        What a reader must know.
    """

    components: dict[str, ModalComponent]
    record: ProjectionRecord
    notes: tuple[str, ...]


def projected_to(projected: Projected) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and facts of the findings; bodies are stored before they are ranked."""
    arrays: Arrays = {}
    bodies = {}
    for name, component in projected.components.items():
        own, bodies[name] = modal_to(component)
        arrays |= {f"{name}.{key}": values for key, values in own.items()}
    record = projected.record
    arrays |= {f"{name}.singular": values for name, values in record.singular.items()}
    for k, sample in enumerate(record.sampled):
        arrays |= {f"{k}.hz": sample.hz, f"{k}.error": sample.error}
    for k, mode in enumerate(record.extraneous):
        arrays[f"{k}.weight"] = mode.weight
    facts = {
        "bodies": bodies,
        "notes": list(projected.notes),
        "sampled": [[sample.configuration, sample.extraneous, sample.predicted] for sample in record.sampled],
        "rank": dict(record.rank),
        "extraneous": [[mode.configuration, mode.hz, asdict(mode.share), mode.mac] for mode in record.extraneous],
        "suppressed": dict(record.suppressed),
        "between": dict(record.between),
        "limit": record.limit,
        "tolerance": record.tolerance,
        "outputs": list(record.outputs),
    }
    return arrays, facts


def projected_from(
    bodies: Mapping[str, FEModel], arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
) -> Projected:
    """Findings from their arrays and facts."""
    components = {}
    for name, own in facts["bodies"].items():
        start = len(name) + 1
        part = {key[start:]: np.asarray(values) for key, values in arrays.items() if key.startswith(f"{name}.")}
        components[name] = modal_from(bodies[name], part, own)
    sampled = tuple(
        SampledModes(name, arrays[f"{k}.hz"], arrays[f"{k}.error"], extraneous, predicted)
        for k, (name, extraneous, predicted) in enumerate(facts["sampled"])
    )
    extraneous = tuple(
        ExtraneousMode(name, hz, ModeShare(**share), arrays[f"{k}.weight"], mac)
        for k, (name, hz, share, mac) in enumerate(facts["extraneous"])
    )
    record = ProjectionRecord(
        sampled,
        {name: arrays[f"{name}.singular"] for name in facts["rank"]},
        facts["rank"],
        extraneous,
        facts["suppressed"],
        facts["between"],
        facts["limit"],
        facts["tolerance"],
        tuple(facts["outputs"]),
    )
    return Projected(components, record, tuple(facts["notes"]))
