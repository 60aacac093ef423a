"""The health of a body as plain values, for summary.json and `inspect --json`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.pipeline.body_health import BodyHealth
from cmsreduce.verify.effective_mass import EffectiveMass
from cmsreduce.verify.mass_properties import MassProperties

__all__ = ["effective_mass_data", "health_data"]

# Dofs named of a kind; the count tells of the others.
_NAMED = 20


def health_data(body: FEModel, health: BodyHealth) -> dict[str, Any]:
    """What was found of a body, in the scene's units; None for what was not looked at."""
    light, motions, held, principal = health.light, health.motions, health.grounding, health.principal
    return {
        "mass_properties": {source: _mass(found) for source, found in health.mass.items()},
        "principal": principal
        and {
            "moments": principal.moments.tolist(),
            "axes": principal.axes.tolist(),
            "radii": principal.radii.tolist(),
            "gyration": principal.gyration.tolist(),
        },
        "rigid_motions": motions
        and {
            **dict(zip(("stiffness_off", "modes_off"), motions.apart(body.M), strict=True)),
            "rigid_hz": motions.rigid_hz.tolist(),
            "first_elastic_hz": motions.elastic_hz,
        },
        "grounding": held
        and {
            "node": int(held.node[held.worst]),
            "force": float(held.translation[held.worst]),
            "moment": float(held.rotation[held.worst]),
            "relative": float(held.relative[held.worst]),
        },
        "massless": _named(body, light.massless),
        "nearly_massless": _named(body, light.nearly),
        "highest_dof": None
        if light.highest < 0
        else {"dof": body.dofs.labels[light.highest], "hz": float(light.highest_hz)},
        "stiffness_contrast": [
            {
                "kind": each.kind,
                "ratio": each.ratio,
                "softest": body.dofs.labels[each.softest],
                "stiffest": body.dofs.labels[each.stiffest],
            }
            for each in health.contrast
        ],
        "negative_motions": dict(health.negative),
    }


def effective_mass_data(found: EffectiveMass, faces: str) -> dict[str, Any]:
    """Effective masses of the modes held at interfaces."""
    return {
        "held": faces,
        "hz": found.hz.tolist(),
        "share": found.share.tolist(),
        "running": found.running.tolist(),
    }


def _mass(found: MassProperties) -> dict[str, Any]:
    return {"mass": found.mass.tolist(), "centre": found.cg.tolist(), "inertia": found.inertia.tolist()}


def _named(body: FEModel, rows: NDArray[np.int64]) -> dict[str, Any]:
    return {"count": int(rows.size), "dofs": [body.dofs.labels[row] for row in rows[:_NAMED]]}
