"""Random solid bodies in responses of a random scene, and their errors by dense algebra on the full matrices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.model import FEModel
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.project import SceneBasis
from tests.pipeline.study import write_body
from tests.solids import block

__all__ = ["Certified", "certified"]

PIPELINE = """\
name: solid
components:
  solid:
    stiffness: {{file: solid.op4, matrix: KAA}}
    mass: {{file: solid.op4, matrix: MAA}}
    geometry: solid.bdf
    rows: rows.txt
    grounded: true
    damping: {{structural: {loss}}}
scene:
  band: {band} Hz
  actuators:
{inputs}
  sensors:
{outputs}
reduce: {{method: scene}}
verify: {{limits: {{frf_error: {limit}}}}}
"""
AXES = np.eye(3, dtype=int).tolist()


@dataclass(frozen=True)
class Certified:
    """Errors of one random case, relative to the response over the band.

    Parameters
    ----------
    first, first_estimate : float
        With the responses of one frequency: the error by dense algebra and its estimate.
    last, last_estimate : float
        At the end.
    allowed : float
        What the estimate had to come below.
    """

    first: float
    first_estimate: float
    last: float
    last_estimate: float
    allowed: float


def certified(rng: np.random.Generator, folder: Path, least: tuple[int, int, int] = (4, 2, 2)) -> Certified:
    """Reduce a random held block, of up to two cells more along each side than ``least``, to responses of a scene."""
    cells = rng.integers(least, np.array(least) + 3)
    sides = rng.uniform(0.1, 0.4, 3)
    body = block("solid", sides.tolist(), cells.tolist(), held=range(1, 1 + int(np.prod(cells[1:] + 1))))
    loss, limit = float(10 ** rng.uniform(-2.5, -1)), float(10 ** rng.uniform(-3, -1))
    w, X = la.eigh(body.K.toarray(), body.M.toarray())
    band = float(np.sqrt(w[rng.integers(3, 25)]) / (2 * np.pi))
    drawn = [[_channel(rng, body) for _ in range(rng.integers(1, 6))] for _ in range(2)]
    inputs = [f"    u{k}: {{at: solid.{node}, force: {AXES[axis]}}}" for k, (node, axis) in enumerate(drawn[0])]
    outputs = [f"    y{k}: {{at: solid.{node}, measure: {'xyz'[axis]}}}" for k, (node, axis) in enumerate(drawn[1])]
    path = folder / "solid.yaml"
    path.write_text(
        PIPELINE.format(loss=loss, band=band, limit=limit, inputs="\n".join(inputs), outputs="\n".join(outputs))
    )
    write_body(folder, body)
    (folder / "rows.txt").write_text("\n".join(body.dofs.labels))
    run = Run(load_pipeline(path), folder, Silent())
    basis = SceneBasis({"solid": run.bodies["solid"]}, {}, run.scene, limit)
    B, C = (X[[_row(body, *each) for each in group]] for group in drawn)

    def error() -> float:
        """Of the shapes now: both responses as sums over all modes, on a grid with every resonance."""
        V = basis.bodies["solid"].shapes
        w_r, q = la.eigh(V.T @ (body.K @ V), V.T @ (body.M @ V))
        X_r = V @ q
        B_r, C_r = (X_r[[_row(body, *each) for each in group]] for group in drawn)
        found = np.sqrt(np.concatenate([w, w_r]))
        found = found[found < 2 * np.pi * band]
        beside = (found[:, None] * (1 + loss * np.linspace(-8, 8, 65))).ravel()
        omega = np.unique(np.concatenate([2 * np.pi * np.linspace(1e-3 * band, band, 400), beside]))
        omega = omega[(omega > 0) & (omega <= 2 * np.pi * band)]
        H, H_r = (
            np.einsum("yk,fk,uk->fyu", left, 1 / (own * (1 + 1j * loss) - omega[:, None] ** 2), right)
            for left, right, own in ((C, B, w), (C_r, B_r, w_r))
        )
        miss, size = (np.trapezoid(np.sum(abs(part) ** 2, axis=(1, 2)), omega) for part in (H - H_r, H))
        return float(np.sqrt(miss / size))

    basis.start()
    first = error(), basis.estimate()
    found = basis.run()
    return Certified(*first, error(), found.estimate, 0.1 * limit)


def _channel(rng: np.random.Generator, body: FEModel) -> tuple[int, int]:
    return int(rng.choice(np.unique(body.dofs.node))), int(rng.integers(3))


def _row(body: FEModel, node: int, axis: int) -> int:
    return int(body.dofs.rows(node, np.array([axis + 1]))[0])
