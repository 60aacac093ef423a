"""Static pictures of the scene and of the modes of the reduced system."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Placement, SceneDrawing, SystemShapes
from cmsreduce.report.palette import INK
from cmsreduce.report.pictures.figure import DOTS_PER_INCH, drawn, literal

__all__ = ["scene_picture", "shapes_picture"]

_BODIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#333333")
# View of the scene, as on the page: turned about z, then tilted, in radians.
_YAW, _PITCH = 0.65, 0.5
# The largest motion as a share of the size of the scene.
_SWING = 0.12
# Height of a line and mean width of a letter of labels, in points.
_LINE, _LETTER = 10.0, 5.2

Points = NDArray[np.float64]


def scene_picture(drawing: SceneDrawing, configuration: str, path: Path) -> None:
    """Draw bodies, joints and channels in one configuration."""
    shapes = drawing.systems[configuration]
    with drawn(path, (7.0, 5.2)) as figure:
        axes = _empty(figure.subplots())
        labels: list[tuple[Points, str, str]] = []
        for k, (name, body) in enumerate(drawing.bodies.items()):
            flat = _seen(_placed(body.xyz, shapes.placements[name]))
            colour = _BODIES[k % len(_BODIES)]
            _lines(axes, flat, body.lines, color=colour, linewidth=1.1)
            labels.append((flat[np.argmax(flat[:, 1])], name, colour))
        for joint in drawing.joints:
            at = _seen(_placed(joint.position[None], shapes.placements[joint.bodies[0]]))[0]
            axes.plot(*at, "o", mfc="white", mec=INK, markersize=7)
            free = ", ".join(joint.free) or "locked"
            labels.append((at, f"{joint.name} ({free})", INK))
        places: dict[tuple[str, str, tuple[float, ...]], list[str]] = {}
        for port in drawing.ports:
            stem = port.name.split(".")[0]
            held = places.setdefault((port.kind, port.body, tuple(port.position.tolist())), [])
            if stem not in held:
                held.append(stem)
        for (kind, of, position), names in places.items():
            at = _seen(_placed(np.array([position]), shapes.placements[of]))[0]
            sign, fill = ("^", "#E69F00") if kind == "actuator" else ("s", "#56B4E9")
            axes.plot(*at, sign, mfc=fill, mec=INK, markersize=7)
            labels.append((at, ", ".join(names), INK))
        _label(axes, labels)
        axes.set_title(literal(f"Scene, {configuration}"), loc="left")


def shapes_picture(drawing: SceneDrawing, configuration: str, path: Path, most: int = 9) -> None:
    """Draw the first modes of the reduced system, each in a panel over the scene at rest."""
    shapes = drawing.systems[configuration]
    count = min(most, shapes.hz.size)
    across = min(3, max(1, count))
    with drawn(path, (3.4 * across, 2.9 * max(1, math.ceil(count / across)))) as figure:
        panels = figure.subplots(max(1, math.ceil(count / across)), across, squeeze=False).ravel()
        for axes in panels:
            _empty(axes)
        for mode, axes in zip(range(count), panels, strict=False):
            _mode(axes, drawing, shapes, mode)
            axes.set_title(f"{mode + 1}: {shapes.hz[mode]:.4g} Hz", loc="left", fontsize=9)


def _mode(axes: Any, drawing: SceneDrawing, shapes: SystemShapes, mode: int) -> None:
    motion = {
        name: np.einsum(
            "pak,k,ba->pb",
            body.shapes[:, :, body.kept],
            shapes.amplitudes[name][:, mode],
            shapes.placements[name].rotation,
        )
        for name, body in drawing.bodies.items()
    }
    rest = {name: _placed(body.xyz, shapes.placements[name]) for name, body in drawing.bodies.items()}
    largest = max(float(np.linalg.norm(each, axis=1).max(initial=0.0)) for each in motion.values())
    size = float(np.linalg.norm(np.ptp(np.vstack(list(rest.values())), axis=0)))
    gain = _SWING * size / largest if largest > 0 else 0.0
    for name, body in drawing.bodies.items():
        _lines(axes, _seen(rest[name]), body.lines, color="#c4ccd4", linewidth=0.7)
        _lines(axes, _seen(rest[name] + gain * motion[name]), body.lines, color="#D55E00", linewidth=1.0)


def _label(axes: Any, labels: list[tuple[Points, str, str]]) -> None:
    """Write each label beside its point, where it covers no other label."""
    axes.figure.canvas.draw()
    pixels = DOTS_PER_INCH / 72
    taken: list[tuple[float, float, float, float]] = []
    for at, text, colour in labels:
        x, y = axes.transData.transform(at) / pixels
        wide = _LETTER * len(text)
        tries = [(dx, (-1) ** k * ((k + 1) // 2) * _LINE) for k in range(9) for dx in (9.0, -9.0 - wide)]
        boxes = [(x + dx, y + dy, x + dx + wide, y + dy + _LINE) for dx, dy in tries]
        free = (
            k
            for k, b in enumerate(boxes)
            if all(b[0] > t[2] or b[2] < t[0] or b[1] > t[3] or b[3] < t[1] for t in taken)
        )
        best = next(free, 0)
        taken.append(boxes[best])
        weight = "bold" if colour != INK else "normal"
        axes.annotate(
            literal(text), at, tries[best], textcoords="offset points", color=colour, weight=weight, fontsize=8
        )


def _lines(axes: Any, flat: Points, lines: NDArray[np.int64], **look: Any) -> None:
    from matplotlib.collections import LineCollection

    if len(lines):
        axes.add_collection(LineCollection(list(flat[lines]), colors=look["color"], linewidths=look["linewidth"]))
    else:
        axes.plot(flat[:, 0], flat[:, 1], ".", color=look["color"], markersize=3)
    axes.update_datalim(flat)
    axes.autoscale_view()


def _empty(axes: Any) -> Any:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_axis_off()
    return axes


def _placed(xyz: Points, place: Placement) -> Points:
    return np.asarray(xyz @ place.rotation.T + place.translation)


def _seen(xyz: Points) -> Points:
    """Points on the screen, right and up."""
    right = np.array([-math.sin(_YAW), math.cos(_YAW), 0.0])
    ahead = np.array([math.cos(_YAW), math.sin(_YAW), 0.0])
    up = math.cos(_PITCH) * np.array([0.0, 0.0, 1.0]) - math.sin(_PITCH) * ahead
    return np.asarray(xyz @ np.column_stack([right, up]))
