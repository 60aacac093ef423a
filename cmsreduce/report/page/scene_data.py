"""Data of the scene and its modes in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from cmsreduce.model import BodyDrawing, ComponentResult, RunResult, SceneDrawing, SystemShapes
from cmsreduce.report.page.curves import all_rounded
from cmsreduce.report.page.packing import ArrayStore

__all__ = ["scene_data"]

# Bytes of all shapes before compression; modes that are not kept are the first to be left out.
_BUDGET = 3_000_000
# Levels of a shape: a 127th of the largest motion is not visible.
_LEVELS = 127


def scene_data(run: RunResult, store: ArrayStore) -> dict[str, Any] | None:
    """Bodies, joints, channels and modes of the scene; None for a scene without a drawing.

    Parameters
    ----------
    run : RunResult
    store : ArrayStore
        Takes points, lines and shapes.
    """
    drawing = run.drawing
    if drawing is None:
        return None
    order = {name: k for k, name in enumerate(drawing.bodies)}
    share = _BUDGET / len(order)
    return {
        "bodies": [_body(body, run.components.get(name), store, share) for name, body in drawing.bodies.items()],
        "joints": [
            {
                "name": joint.name,
                "body": order[joint.bodies[0]],
                "bodies": list(joint.bodies),
                "at": _triple(joint.position),
                "axes": [_triple(axis) for axis in joint.axes],
                "free": list(joint.free),
            }
            for joint in drawing.joints
        ],
        "ports": [
            {"name": port.name, "kind": port.kind, "body": order[port.body], "at": _triple(port.position)}
            for port in drawing.ports
        ],
        "systems": [_system(name, shapes, drawing, store) for name, shapes in drawing.systems.items()],
        "length": drawing.length,
    }


def _body(body: BodyDrawing, part: ComponentResult | None, store: ArrayStore, share: float) -> dict[str, Any]:
    p, _, m = body.shapes.shape
    most = max(body.kept.size, int(share / max(1, 3 * p)))
    left_out = np.setdiff1d(np.arange(m), body.kept)[: max(0, most - body.kept.size)]
    shown = np.sort(np.concatenate([body.kept, left_out])).astype(np.int64)
    # Ordered by mode, then by point: the page reads a mode in one piece.
    shapes = np.moveaxis(body.shapes[:, :, shown], -1, 0)
    scale = abs(shapes).max(axis=(1, 2), initial=0.0)
    levels = np.rint(shapes / np.where(scale > 0, scale, 1.0)[:, None, None] * _LEVELS)
    modes: list[dict[str, Any]] = []
    if part is not None and body.flexible:
        every = part.modes
        kept = set(body.kept.tolist())
        hz = [None if np.isinf(w) else w / (2 * np.pi) for w in every.omega[shown]]
        modes = [
            {"number": int(c) + 1, "hz": f, "kind": every.kind[c], "kept": int(c) in kept}
            for c, f in zip(shown, [None if f is None else float(f"{f:.5g}") for f in hz], strict=True)
        ]
    return {
        "name": body.name,
        "flexible": body.flexible,
        "meshed": body.labelled,
        "left_out": body.left_out,
        "xyz": store.exact(body.xyz, "f4"),
        "lines": store.exact(body.lines, "u2" if p <= 0xFFFF else "u4"),
        "shapes": store.exact(levels, "i1"),
        "scale": store.exact(scale / _LEVELS, "f4"),
        "coordinates": np.searchsorted(shown, body.kept).tolist(),
        "modes": modes,
    }


def _system(name: str, shapes: SystemShapes, drawing: SceneDrawing, store: ArrayStore) -> dict[str, Any]:
    return {
        "name": name,
        "hz": all_rounded(shapes.hz),
        "zeta": all_rounded(100 * shapes.zeta),
        # Ordered by mode, then by the coordinates of the body.
        "amplitudes": [store.exact(np.asarray(shapes.amplitudes[body]).T, "f4") for body in drawing.bodies],
        "rotation": [all_rounded(shapes.placements[body].rotation.ravel()) for body in drawing.bodies],
        "translation": [_triple(shapes.placements[body].translation) for body in drawing.bodies],
    }


def _triple(values: Any) -> list[float | None]:
    return all_rounded(np.asarray(values, dtype=np.float64).ravel())
