"""The stages one by one, for bodies in memory: read, orthogonalise, balance, assemble, write.

Each function takes plain values and calls the stage of its name; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cmsreduce.assemble import body_points, body_ports, modal_substructure, rigid_substructure
from cmsreduce.balance import Ranking
from cmsreduce.body_in_memory import (
    FaceLike,
    MatrixLike,
    RowsLike,
    faces_in_memory,
    law_in_memory,
    matrix_in_memory,
    rows_in_memory,
)
from cmsreduce.config import (
    CLOSED_LOOP,
    SYSTEM_COST,
    Pipeline,
    build_scene,
    check_name,
    pipeline_from_keys,
)
from cmsreduce.errors import ConfigError, DofMapError, SceneError, UnitsError
from cmsreduce.model import SI, Damping, FEModel, ModalComponent, ReducedComponent, Units
from cmsreduce.models_in_memory import AssembledSystem, Component
from cmsreduce.orthogonalise import orthogonalise as orthonormal_modes
from cmsreduce.pipeline.bodies import read_rigid
from cmsreduce.pipeline.choose import ranked, ranking_channels, select, truncate
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.read import files_read, prove_mass_order
from cmsreduce.read import read_body as read_from_files
from cmsreduce.verify import rigid_shapes
from cmsreduce.write import write_component as write_component_file

__all__ = ["assemble", "balance", "orthogonalise", "read_body", "write_component"]

Keys = Mapping[str, Any]

# Every mode of the bodies is used, so that the band of the scene decides nothing; the grammar asks for one.
_ANY_BAND = "1 Hz"


def read_body(
    name: str,
    *,
    stiffness: MatrixLike,
    mass: MatrixLike,
    geometry: str | Path | None = None,
    interfaces: Mapping[str, FaceLike] | None = None,
    rows: RowsLike | None = None,
    damping: float | str | Damping | None = None,
    damping_matrix: MatrixLike | None = None,
    units: str | Units = SI,
    grounded: bool = False,
    rows_trusted: bool = False,
) -> FEModel:
    """Read a finite-element body, or take its matrices from memory, and prove the order of its rows.

    Parameters
    ----------
    name : str
        Name of the body, of letters, digits, _ and -, as those of its interfaces.
    stiffness, mass : path, (path, matrix name), array or sparse array
        Matrices (n, n) in ``units``. The name is needed where a file holds several matrices.
    geometry : path, optional
        Deck or mesh with the nodes.
    interfaces : mapping of name to node id, node ids or mapping, optional
        Nodes at which joints attach; each takes all dofs of its nodes. A mapping has the keys of a pipeline file, such
        as ``{"near": [0, 0, 0.2], "within": 0.01, "tie": "rigid"}``.
    rows : path, str, sequence of str or of pairs, optional
        Dof of each row: a dof set of the deck such as ``a``, a file, or texts ``NODE.COMPONENT`` or pairs of both, with
        components 1 to 6. By default the files state the rows.
    damping : float, str or Damping, optional
        Damping ratio of every elastic mode, such as 0.005 or ``0.5 %``, or another law.
    damping_matrix : as ``stiffness``, optional
        Viscous damping matrix instead of a law.
    units : str or Units
        Unit system of the data, such as ``mm-t-s``; `in_units` converts a body.
    grounded : bool
        True if the matrices hold the body to the ground.
    rows_trusted : bool
        True to go on with rows whose order is not proven; the mass is still checked.

    Raises
    ------
    CmsReduceError
        If files, rows, interfaces and matrices do not fit together; the message says where and why.
    """
    for given in (name, *(interfaces or {})):
        try:
            check_name(given)
        except ValueError as error:
            raise ConfigError(f"read_body: {error}") from None
    if not isinstance(geometry, (str, Path, type(None))):
        raise ConfigError(
            f"read_body: geometry is the name of a deck or mesh, found {type(geometry).__name__}; write nodes that are "
            "in memory to a text file: a line `Node<tab>X<tab>Y<tab>Z`, then a line of number and place for each"
        )
    units = Units.parse(units) if isinstance(units, str) else units
    faces = faces_in_memory(name, interfaces or {}, units)
    with TemporaryDirectory() as folder, files_read():
        damper = None if damping_matrix is None else matrix_in_memory("damping", damping_matrix, Path(folder))
        body = read_from_files(
            name,
            stiffness=matrix_in_memory("stiffness", stiffness, Path(folder)),
            mass=matrix_in_memory("mass", mass, Path(folder)),
            geometry=None if geometry is None else Path(geometry),
            rows=rows_in_memory(rows, Path(folder)),
            damping=law_in_memory(damping),
            damping_matrix=damper,
            units=units,
            grounded=grounded,
            rows_trusted=rows_trusted,
            interfaces=faces.specs,
        )
    prove_mass_order(body)
    return faces.tied(body)


def orthogonalise(reduced: ReducedComponent) -> Component:
    """Bring a reduced body to orthonormal modes.

    Parameters
    ----------
    reduced : ReducedComponent
        As a mode set returns it: ``CraigBampton(cutoff_hz=20).reduce(body)``.
    """
    return Component.of(orthonormal_modes(reduced))


def balance(
    component: ModalComponent,
    rank: str | Ranking = "gregory",
    keep: int | str | Keys = "all",
    *,
    actuators: Keys | None = None,
    sensors: Keys | None = None,
    **keys: Any,
) -> Component:
    """Rank the elastic modes of one body by their influence, and keep the most important ones.

    Interfaces count as inputs and as outputs, as in a pipeline.

    Parameters
    ----------
    component : ModalComponent
        The body in its modes.
    rank : str or Ranking
        Ranking: gregory, hankel, component-cost, modal-gain or frequency, or your own.
    keep : int, "all" or mapping
        Number of elastic modes, or a rule of the pipeline file for one body: {"fraction": 1e-4}, {"bound": 0.05}.
    actuators, sensors : mapping, optional
        Further inputs and outputs on this body, with the keys of a pipeline file.
    **keys
        Other keys of ``balance:``, such as ``scaling``.

    Returns
    -------
    Component
        With the modes kept; its ``table`` has the coefficient of each.

    Raises
    ------
    CmsReduceError
        If a key is wrong, a mode has no damping that the ranking needs, or the rule needs the whole system.
    """
    rule = {"modes": int(keep)} if isinstance(keep, Integral) else keep
    name = rank if isinstance(rank, str) else rank.name
    # The keys need the name of a ranking; modal-gain needs no damping, and the user's own ranking replaces it.
    wanted = {"rank": rank if isinstance(rank, str) else "modal-gain", "keep": rule, **keys}
    scene = {"actuators": actuators or {}, "sensors": sensors or {}}
    pipeline = _pipeline("balance", {component.name: component}, scene, {"balance": wanted})
    chosen, found = pipeline.balance_of(component.name), build_scene(pipeline)
    assert chosen is not None
    if chosen.rank in (SYSTEM_COST, CLOSED_LOOP) or chosen.keep.rule == "frf_error":
        raise ConfigError(
            f"balance: {SYSTEM_COST}, {CLOSED_LOOP} and frf_error measure the joined system; use a pipeline file for "
            "them"
        )
    ports = body_ports(component.body, found)
    component = ranked(component, ports, chosen, found)
    channels = ranking_channels(component, ports, chosen, found)
    if isinstance(rank, Ranking):
        component = rank.rank(component, channels)
    own = {component.name: component}
    kept = select(own, chosen, {component.name: channels}).selection
    return Component.of(truncate(own, kept, {component.name: f"{name}, keep {keep}"})[component.name])


def assemble(
    bodies: Mapping[str, ModalComponent | Keys],
    *,
    joints: Keys | None = None,
    articulation: Keys | Sequence[Keys] | None = None,
    actuators: Keys | None = None,
    sensors: Keys | None = None,
    place: Keys | None = None,
    **keys: Any,
) -> AssembledSystem:
    """Join reduced bodies and rigid ones.

    Parameters
    ----------
    bodies : mapping of name to ModalComponent or mapping
        Reduced bodies under their own names; a rigid body by its keys ``rigid`` and ``interfaces``. Articulation does
        not move the first one.
    joints, articulation, actuators, sensors : mapping, optional
        As under ``scene:`` of a pipeline file. Values are in m-kg-s, or in the units of the reduced bodies; angles need
        their unit, as in ``"45 deg"``.
    place : mapping of body to mapping, optional
        Moves bodies from the basic frame that all share: {"left": {"at": [0, 0, 1.5]}}.
    **keys
        Other keys of ``scene:``, such as ``ground``.

    Returns
    -------
    AssembledSystem
        In the first configuration.

    Raises
    ------
    CmsReduceError
        If a key is wrong, interfaces do not meet, or joints contradict each other.
    """
    scene = {"joints": joints, "articulation": articulation, "actuators": actuators, "sensors": sensors, **keys}
    pipeline = _pipeline("assemble", bodies, {k: v for k, v in scene.items() if v is not None}, {}, place or {})
    built = build_scene(pipeline)
    for parameter, given in pipeline.scene.parameters.items():
        named = {name for matrices in given.matrices().values() for name in matrices}
        of = {name for name in named if isinstance(body := bodies[name], ModalComponent) and body.terms}
        if lacking := sorted(named - of):
            raise SceneError(
                f"assemble: the reduced body '{lacking[0]}' has no matrices of parameter '{parameter}'; a body gets "
                "them in a pipeline, before it is reduced"
            )
    substructures = {
        name: modal_substructure(body, body_points(built, body.body))
        if isinstance(body, ModalComponent)
        else rigid_substructure(read_rigid(pipeline, name, built))
        for name, body in bodies.items()
    }
    return AssembledSystem(AssembledModel(substructures, built), built.configurations[0])


def _pipeline(
    caller: str, bodies: Mapping[str, ModalComponent | Keys], scene: Keys, stages: Keys, place: Keys | None = None
) -> Pipeline:
    """Pipeline with these bodies, so that names and keys are checked as those of a file are."""
    parts: dict[str, Any] = {}
    for name, body in bodies.items():
        if not isinstance(body, ModalComponent):
            if not isinstance(body, Mapping):
                raise SceneError(
                    f"{caller}: '{name}' is a {type(body).__name__}; a flexible body is reduced first: "
                    "orthogonalise(CraigBampton(cutoff_hz=...).reduce(body))"
                )
            parts[name] = dict(body)
            continue
        if body.name != name:
            raise SceneError(f"{caller}: the body under '{name}' is named '{body.name}'; use one name")
        faces = {label: {"nodes": face.node.tolist()} for label, face in body.body.interfaces.items()}
        parts[name] = {"stiffness": {"file": "memory"}, "mass": {"file": "memory"}, "interfaces": faces}
    units = {body.body.units for body in bodies.values() if isinstance(body, ModalComponent)}
    if len(units) > 1:
        names = ", ".join(sorted(each.name for each in units))
        raise UnitsError(f"{caller}: the bodies are in different units ({names}); convert them with in_units")
    unit = {"units": next(iter(units)).name} if units else {}
    for name, position in (place or {}).items():
        parts.setdefault(name, {})["place"] = position
    keys = {"name": caller, "components": parts, "scene": {"band": _ANY_BAND, **unit, **scene}, **stages}
    return pipeline_from_keys(keys, caller)


def write_component(
    component: ModalComponent, path: str | Path, *, nodes: Sequence[int] = (), all_nodes: bool = False
) -> Path:
    """Write a reduced body to a component file; `convert` turns it into the file of another program.

    Parameters
    ----------
    component : ModalComponent
        The body in its modes.
    path : path
        HDF5 file; it is written whole or not at all.
    nodes : sequence of int
        Nodes whose shapes are written beside those of the interfaces.
    all_nodes : bool
        Write the shapes of every node.

    Raises
    ------
    DofMapError
        If the body has none of these nodes.
    """
    body = component.body
    known = {*body.recovery.dofs.node_ids.tolist(), *(() if body.nodes is None else body.nodes.id.tolist())}
    if missing := [node for node in nodes if node not in known]:
        raise DofMapError(f"write_component: body '{body.name}' has no node {missing[0]}, to write its shapes")
    write_component_file(
        Path(path),
        component,
        nodes=nodes,
        inputs={},
        outputs={},
        checks=rigid_shapes(component),
        provenance={},
        all_nodes=all_nodes,
    )
    return Path(path)
