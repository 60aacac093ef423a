"""The mode sets on three bodies: error against size and time.

Prints one Markdown table. Each body carries a rigid payload, and hangs on a rigid hub or on the ground. The error
compares the response of the whole scene with the full and with the reduced body, over the band.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import Cells, free_bar  # noqa: E402
from cmsreduce.assemble import (  # noqa: E402
    assemble,
    body_points,
    body_ports,
    frequency_response,
    grounded_rows,
    interface_substructure,
    modal_substructure,
    neighbour_loading,
    outboard_loading,
    physical_substructure,
    rigid_substructure,
    system_modes,
)
from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.linalg.eigen import rigid_body_modes  # noqa: E402
from cmsreduce.mechanics import Tie, tie_nodes  # noqa: E402
from cmsreduce.model import (  # noqa: E402
    Channel,
    Configuration,
    Damping,
    FEModel,
    Interface,
    Joint,
    ModalComponent,
    Point,
    PointTerm,
    RigidBody,
    Scene,
    Substructure,
    rigid_body_shapes,
)
from cmsreduce.orthogonalise import orthogonalise  # noqa: E402
from cmsreduce.pipeline import Run, Silent  # noqa: E402
from cmsreduce.reduce import MacNealRubin, reduction  # noqa: E402
from cmsreduce.verify import db_error, decibel_grid, frequency_grid, frf_error  # noqa: E402
from tests.frames import frame  # noqa: E402

# With the response to the inertia of the static shapes, too: `inertia: true`.
INERTIA = " + inertia"
METHODS = ("craig-bampton", f"craig-bampton{INERTIA}", "macneal-rubin", f"macneal-rubin{INERTIA}", "benfield-hruda")
METHODS += ("augmented", "guyan", f"guyan{INERTIA}")
CUTOFFS = (1.0, 2.0, 4.0)
# Reference model: the dofs of the body where a solve per frequency is quick, else free modes this far above the band.
DIRECT, BEYOND = 2000, 8.0
LOSS = 0.02
AS_BUILT = Configuration("as built")


@dataclass(frozen=True, eq=False)
class Case:
    """A body in a scene of rigid neighbours."""

    title: str
    body: FEModel
    rigid: dict[str, RigidBody]
    scene: Scene


def cases() -> Iterator[Case]:
    """Three bodies: beams with crowded modes, a lattice on a redundant interface, a solid of 53 000 dofs."""
    rotor = galileo_rotor()
    at = rotor.interfaces["spin_bearing"].position[0]
    yield Case("Galileo rotor, 243 dofs", rotor, {"hub": lump("hub", at, 1500.0)}, scene(rotor, 10.0, "spin_bearing"))
    boom = lattice_boom()
    tip = boom.interfaces["tip"].position[0]
    yield Case(
        f"lattice boom, {boom.n} dofs, held at four nodes",
        boom,
        {"payload": lump("payload", tip, 20.0)},
        scene(boom, 60.0, None, "tip", "root"),
    )
    yield bracket_case((60, 16, 16))


def bracket_case(cells: Cells) -> Case:
    """The solid bracket between a hub and a payload."""
    bracket = solid_bracket(cells)
    root, tip = (bracket.interfaces[name].position[0] for name in ("root", "tip"))
    return Case(
        f"solid bracket, {bracket.n} dofs",
        bracket,
        {"hub": lump("hub", root, 300.0), "payload": lump("payload", tip, 40.0)},
        scene(bracket, 1200.0, "root", "tip"),
    )


def galileo_rotor() -> FEModel:
    """The rotor of the sample, with a loss factor for its damping."""
    with tempfile.TemporaryDirectory() as folder:
        run = Run(load_pipeline(ROOT / "pipelines" / "galileo.yaml"), Path(folder), Silent())
        return replace(run.bodies["rotor"].body, damping=Damping(structural=LOSS))


def lattice_boom(bays: int = 10) -> FEModel:
    """Square lattice boom of bars, one diagonal a face."""
    xyz = [[0.5 * x, y, z] for x in range(bays + 1) for y, z in ((0, 0), (0.4, 0), (0.4, 0.4), (0, 0.4))]
    bars = [(4 * x + k + 1, 4 * x + (k + 1) % 4 + 1) for x in range(bays + 1) for k in range(4)]
    bars += [(4 * x + k + 1, 4 * x + k + 5) for x in range(bays) for k in range(4)]
    bars += [(4 * x + k + 1, 4 * x + (k + 1) % 4 + 5) for x in range(bays) for k in range(4)]
    faces = {"root": (1, 2, 3, 4), "tip": 4 * bays + 1}
    return frame("boom", xyz, bars, faces, damping=Damping(structural=LOSS))


def solid_bracket(cells: Cells) -> FEModel:
    """Steel bar of hexahedra, both ends tied rigidly to a point."""
    body = replace(free_bar(cells), damping=Damping(structural=LOSS))
    for name, x in (("root", 0.0), ("tip", 1.0)):
        assert body.nodes is not None
        ids = body.nodes.id[np.isclose(body.nodes.xyz[:, 0], x)]
        places = body.nodes.xyz[body.nodes.index(ids)]
        face = Interface(name, ids, ((1, 2, 3),) * ids.size, places, np.eye(3))
        body = tie_nodes(replace(body, interfaces={**body.interfaces, name: face}), name, Tie("rigid"))
    return body


def lump(name: str, at: np.ndarray, mass: float) -> RigidBody:
    """Rigid neighbour whose centre of mass is a little off the joint."""
    arm = np.array([0.05, 0.03, 0.02])
    face = Interface("face", np.array([-1]), ((1, 2, 3, 4, 5, 6),), at[None], np.eye(3), np.eye(3)[None])
    return RigidBody(name, mass, at + arm, 0.05 * mass * np.diag([1.0, 1.2, 0.9]), {"face": face})


def scene(body: FEModel, band: float, hub: str | None, payload: str | None = None, ground: str | None = None) -> Scene:
    """The body between its neighbours, shaken and measured at them."""
    ends = {name: face for name, face in (("hub", hub), ("payload", payload)) if face}
    joints = tuple(Joint(name, Point(name, "face"), Point(body.name, face)) for name, face in ends.items())
    shaken, seen = next(iter(ends)), list(ends)[-1]
    forces = tuple(
        Channel(f"push {k}", (PointTerm(Point(shaken, "cg"), np.eye(6)[k]),), "translation") for k in range(3)
    )
    twist = (Channel("twist", (PointTerm(Point(shaken, "cg"), np.eye(6)[5]),), "rotation"),)
    motions = tuple(
        Channel(f"move {k}", (PointTerm(Point(seen, "cg"), np.eye(6)[k]),), "translation") for k in range(3)
    )
    held = (Point(body.name, ground),) if ground else ()
    return Scene((body.name, *ends), (0.0, band), joints, (AS_BUILT,), forces + twist, motions, body.name, held)


def response(case: Case, sub: Substructure, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Response of the scene, whole and without its rigid part."""
    subs = {case.body.name: sub, **{name: rigid_substructure(body) for name, body in case.rigid.items()}}
    H = frequency_response(subs, case.scene, AS_BUILT, omega)
    system = assemble(subs, case.scene, AS_BUILT)
    Pr = system.rigid
    return H, H + np.einsum("ij,jk,f->fik", system.C1 @ Pr, Pr.T @ system.B, 1 / omega**2)


def reduced(case: Case, method: str, cutoff: float, rigid: np.ndarray) -> tuple[ModalComponent, float]:
    """Orthonormal modes of a set, and the seconds they took; the loading by the neighbours is counted."""
    body, top = case.body, case.scene.band[1]
    ports = body_ports(body, case.scene)
    started = time.perf_counter()
    loading = None
    if method == "benfield-hruda":
        here = interface_substructure(body, ports.interface, body.interfaces)
        others = [rigid_substructure(part) for part in case.rigid.values()]
        loading = neighbour_loading(here, others, case.scene)
    if method == "augmented":
        loading = outboard_loading(body, ports.interface, {body.name: body, **case.rigid}, case.scene)
    if loading is not None:
        loading = replace(loading, grounded=grounded_rows(body, ports.interface, case.scene))
    plain, inertia = method.removesuffix(INERTIA), method.endswith(INERTIA)
    kind = reduction(plain, cutoff * top, None, loading, inertia=inertia)
    component = kind.reduce(body, ports.interface, ports.static_loads, rigid)
    return orthogonalise(component), time.perf_counter() - started


def reference(case: Case, rigid: np.ndarray) -> Substructure:
    """The unreduced body, or free modes far above the band with all static shapes."""
    points = body_points(case.scene, case.body)
    if case.body.n <= DIRECT:
        return physical_substructure(case.body, points, rigid)
    ports = body_ports(case.body, case.scene)
    many = MacNealRubin(BEYOND * case.scene.band[1]).reduce(case.body, ports.interface, None, rigid)
    return modal_substructure(orthogonalise(many), points)


def direct_difference(case: Case, stand_in: Substructure, rigid: np.ndarray) -> float:
    """Difference of the reference model from a direct solve with all dofs, at two frequencies in the upper band."""
    omega = 2 * np.pi * case.scene.band[1] * np.array([0.47, 0.93])
    full = physical_substructure(case.body, body_points(case.scene, case.body), rigid)
    H, H_stand = (response(case, sub, omega)[0] for sub in (full, stand_in))
    return float(np.linalg.norm(H - H_stand) / np.linalg.norm(H))


def main() -> None:
    """Print the table."""
    print("| body | mode set | cutoff / band | columns | seconds | frf_error | db_error |")
    print("|---|---|---|---|---|---|---|")
    remarks = []
    for case in cases():
        body = case.body
        assert body.nodes is not None
        R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
        rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
        full = reference(case, rigid)
        if body.n > DIRECT:
            remarks.append(
                f"{case.title}: the reference differs from a direct solve by {direct_difference(case, full, rigid):.1e}"
            )
        subs = {body.name: full, **{name: rigid_substructure(part) for name, part in case.rigid.items()}}
        w, _ = system_modes(assemble(subs, case.scene, AS_BUILT), 2 * np.pi * case.scene.band[1])
        omega = frequency_grid(case.scene.band, 200, w, np.full(w.size, LOSS / 2))
        _, elastic = response(case, full, omega)
        grid = decibel_grid(case.scene.band)
        whole, _ = response(case, full, grid)
        row, column = np.ones(elastic.shape[1]), np.ones(elastic.shape[2])
        for method in METHODS:
            for cutoff in CUTOFFS if not method.startswith("guyan") else (2.0,):
                modes, seconds = reduced(case, method, cutoff, rigid)
                sub = modal_substructure(modes, body_points(case.scene, body))
                _, elastic_r = response(case, sub, omega)
                whole_r, _ = response(case, sub, grid)
                shown = "-" if method.startswith("guyan") else f"{cutoff:g}"
                print(
                    f"| {case.title} | {method} | {shown} | {modes.basis_size} | {seconds:.2f} "
                    f"| {100 * frf_error(omega, elastic, elastic_r, row, column):.3g} % "
                    f"| {db_error(whole, whole_r, row, column):.3g} dB |",
                    flush=True,
                )
    for remark in remarks:
        print(f"\n{remark}")


if __name__ == "__main__":
    main()
