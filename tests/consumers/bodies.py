"""Reduced bodies in the frame that a floating-frame code moves, written as that code's file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.linalg as la

from cmsreduce.model import FEModel, FloatingFrame, IntegralFrame, ModalComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import convert, write_component

__all__ = ["ALL", "clamped", "modes", "npz"]

ALL = 1e9  # Hz: every mode is kept


def modes(body: FEModel, cutoff_hz: float = ALL) -> ModalComponent:
    """Craig-Bampton modes of a body over all its interfaces, orthonormal."""
    rows = [body.interface_rows(name) for name in body.interfaces]
    return orthogonalise(CraigBampton(cutoff_hz).reduce(body, np.concatenate(rows)))


def clamped(component: ModalComponent, interface: str) -> ModalComponent:
    """The same elastic shapes, seen from the one node of an interface, which no longer moves or turns in them."""
    body = component.body
    rows = body.interface_rows(interface)
    rigid = rigid_body_shapes(body.dofs, body.nodes, body.interfaces[interface].position[0])
    Phi = component.Phi[:, component.rigid_count :]
    Phi = Phi - rigid @ np.linalg.solve(rigid[rows], Phi[rows])
    Phi[rows] = 0.0
    lam, X = la.eigh(np.diag(component.stiffness[component.rigid_count :]), Phi.T @ (body.M @ Phi))
    kept = slice(component.rigid_count, None)
    return replace(
        component,
        Phi=Phi @ X,
        omega=np.sqrt(lam),
        zeta=component.zeta[kept],
        rigid_count=0,
        kind=component.kind[kept],
        source_hz=component.source_hz[kept],
        sigma=component.sigma[kept],
        spacing=component.spacing[kept],
        why=component.why[kept],
        rankings={},
    )


def npz(folder: Path, component: ModalComponent, frame: FloatingFrame | None = None) -> Path:
    """Component file, and from it alone the one that Exudyn loads; mesh nodes are all nodes, in order of their ids.

    With a floating frame the integrals are about its place, along its axes.
    """
    path = folder / f"{component.name}.h5"
    write_component(
        path,
        component,
        nodes=(),
        inputs={},
        outputs={},
        checks=(),
        provenance={"settings": {}},
        all_nodes=True,
        frame=frame,
        about=None if frame is None else IntegralFrame("frame", frame.origin, frame.axes),
    )
    return convert(path, path.with_suffix(".npz"), "exudyn")[0]
