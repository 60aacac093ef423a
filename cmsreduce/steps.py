"""The stages one by one, for bodies in memory: read, orthogonalise, balance, assemble, write.

Each function takes plain values and calls the stage of its name; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.assemble import body_points, body_ports, modal_substructure, rigid_substructure, state_space
from cmsreduce.balance import Ranking
from cmsreduce.config import CLOSED_LOOP, SYSTEM_COST, Pipeline, build_scene, parse_ratio, pipeline_from_keys
from cmsreduce.errors import ConfigError, DampingError, DofMapError, SceneError, UnitsError, not_among, optional_library
from cmsreduce.model import SI, Configuration, Damping, FEModel, ModalComponent, ReducedComponent, Units
from cmsreduce.orthogonalise import orthogonalise as orthonormal_modes
from cmsreduce.pipeline.bodies import read_rigid
from cmsreduce.pipeline.choose import ranked, ranking_channels, select, truncate
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.read import InterfaceSpec, MatrixSource, prove_mass_order
from cmsreduce.read import read_body as read_from_files
from cmsreduce.write import basic_shapes
from cmsreduce.write import write_component as write_component_file

if TYPE_CHECKING:
    import control
    import pandas as pd

__all__ = [
    "AssembledSystem",
    "Component",
    "assemble",
    "balance",
    "orthogonalise",
    "read_body",
    "write_component",
]

Keys = Mapping[str, Any]
MatrixLike = str | Path | tuple[str | Path, str] | MatrixSource | NDArray[np.float64] | sp.sparray | sp.spmatrix

# Every mode of the bodies is used, so that the band of the scene decides nothing; the grammar asks for one.
_ANY_BAND = "1 Hz"


class Component(ModalComponent):
    """A reduced body in its modes: rigid ones, then elastic ones by frequency, then static ones."""

    @classmethod
    def of(cls, modal: ModalComponent) -> Component:
        """Component of the modes that a stage returns."""
        return cls(**{each.name: getattr(modal, each.name) for each in fields(modal)})

    @property
    def table(self) -> pd.DataFrame:
        """One row a mode: frequency in Hz, damping ratio, kind, influence coefficient, and why it is kept."""
        pandas = optional_library("pandas", "pandas", "tables in Python")
        columns = {"damping_ratio": self.zeta, "kind": self.kind, "coefficient": self.sigma, "why": self.why}
        frame: pd.DataFrame = pandas.DataFrame({"frequency_hz": self.frequencies_hz, **columns}).rename_axis("mode")
        return frame

    def to_frame(self) -> pd.DataFrame:
        """The same as `table`."""
        return self.table

    def shapes(self, point: str | int) -> NDArray[np.float64]:
        """Translation and rotation of a point in each mode, along the basic axes of the body.

        Parameters
        ----------
        point : str or int
            Interface of one node, or node id.

        Returns
        -------
        (6, modes) float64
            x y z rx ry rz; NaN where the body does not determine a motion, as the rotation of a solid's node.

        Raises
        ------
        SceneError
            If there is no such point, or the interface has several nodes.
        DofMapError
            If the body has no geometry.
        """
        body, label = self.body, str(point)
        nodes = [int(label)] if label.isdigit() else []
        if label in body.interfaces:
            nodes = body.interfaces[label].node.tolist()
        if len(nodes) > 1:
            ids = ", ".join(map(str, nodes))
            raise SceneError(f"interface '{self.name}.{label}' has {len(nodes)} nodes; name one of them: {ids}")
        if body.nodes is None:
            raise DofMapError(f"body '{self.name}' has no geometry, so the axes of its nodes are not known")
        if not nodes:
            raise SceneError(f"body '{self.name}': {not_among('interface', label, body.interfaces)}; or a node id")
        if body.nodes.index(np.array(nodes))[0] < 0:
            raise SceneError(f"body '{self.name}': its geometry has no node {nodes[0]}")
        at = np.array(nodes)
        parts = [basic_shapes(body, body.nodes, self.Phi, at, motion)[0] for motion in ("translation", "rotation")]
        return np.concatenate(parts)


class AssembledSystem:
    """Joined bodies in one configuration.

    Parameters
    ----------
    model : AssembledModel
        Bodies and scene.
    configuration : Configuration
        Positions of the joints.
    """

    def __init__(self, model: AssembledModel, configuration: Configuration) -> None:
        self.model, self.configuration = model, configuration
        self.matrices = model.system(configuration)
        """Mass, stiffness, damping, inputs and outputs; see `cmsreduce.model.System`."""

    @property
    def configurations(self) -> tuple[str, ...]:
        """Names of all configurations, such as ``spin=45 cone=30`` with angles in degrees."""
        return tuple(each.name for each in self.model.scene.configurations)

    def at(self, configuration: str) -> AssembledSystem:
        """The system in another configuration, by its name; the joints may stand in any order.

        Raises
        ------
        SceneError
            If there is none of this name; the message lists all names.
        """
        for each in self.model.scene.configurations:
            if sorted(each.name.split()) == sorted(str(configuration).split()):
                return AssembledSystem(self.model, each)
        raise SceneError(not_among("configuration", str(configuration), self.configurations))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the columns of a response."""
        return self.matrices.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the motions that sensors measure, in the order of the rows of a response."""
        return self.matrices.outputs

    @cached_property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Undamped natural frequencies in Hz, ascending; zero for each rigid motion and each free motion of a joint."""
        omega, _, _ = self.model.every_mode(self.configuration)
        return np.concatenate([np.zeros(self.matrices.rigid.shape[1]), omega]) / (2 * np.pi)

    def response(self, frequencies_hz: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response, rigid motions included.

        Parameters
        ----------
        frequencies_hz : (f,) array_like
            Frequencies in Hz, above zero if the system can move freely.

        Returns
        -------
        (f, outputs, inputs) complex128
            Displacement or angle in rad, or its rate, per unit force or torque.
        """
        return self.model.response(self.configuration, 2 * np.pi * np.atleast_1d(np.asarray(frequencies_hz, float)))

    def state_space(self) -> control.StateSpace:
        """State space with the inputs and outputs of the scene; states are coordinates, then their rates."""
        return state_space(self.matrices)

    def __repr__(self) -> str:
        size = f"{self.matrices.N} coordinates, {self.matrices.rigid.shape[1]} rigid motions"
        channels = f"{len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<AssembledSystem {self.configuration.name}: {size}, {channels}>"


def read_body(
    name: str,
    *,
    stiffness: MatrixLike,
    mass: MatrixLike,
    geometry: str | Path | None = None,
    interfaces: Mapping[str, int | Sequence[int] | InterfaceSpec] | None = None,
    rows: str | Path | Sequence[str] | None = None,
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
        Name of the body.
    stiffness, mass : path, (path, matrix name), array or sparse array
        Matrices (n, n) in ``units``. The name is needed where a file holds several matrices.
    geometry : path, optional
        Deck or mesh with the nodes.
    interfaces : mapping of name to node id or node ids, optional
        Nodes at which joints attach; each takes all dofs of its nodes. An `InterfaceSpec` states dofs or axes.
    rows : path, str or sequence of str, optional
        Dof of each row: a dof set of the deck such as ``a``, a file, or texts ``NODE.COMPONENT`` with components
        1 to 6. By default the files state the rows.
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
    specs = {}
    for label, nodes in (interfaces or {}).items():
        ids = nodes if isinstance(nodes, (InterfaceSpec, Sequence)) else (int(nodes),)
        specs[label] = ids if isinstance(ids, InterfaceSpec) else InterfaceSpec(tuple(ids))
    with TemporaryDirectory() as folder:
        if rows is not None and not isinstance(rows, (str, Path)):
            listed = Path(folder) / "rows.txt"
            listed.write_text("\n".join(rows), encoding="utf-8")
            rows = listed
        body = read_from_files(
            name,
            stiffness=_source(stiffness, Path(folder) / "stiffness.npz"),
            mass=_source(mass, Path(folder) / "mass.npz"),
            geometry=None if geometry is None else Path(geometry),
            rows=rows,
            damping=_law(damping),
            damping_matrix=None if damping_matrix is None else _source(damping_matrix, Path(folder) / "damping.npz"),
            units=Units.parse(units) if isinstance(units, str) else units,
            grounded=grounded,
            rows_trusted=rows_trusted,
            interfaces=specs,
        )
    prove_mass_order(body)
    return body


def _law(damping: float | str | Damping | None) -> Damping | None:
    """Law of a body from one ratio of all its modes; another law stays as it is."""
    if damping is None or isinstance(damping, Damping):
        return damping
    ratio = parse_ratio(damping)
    if not isinstance(ratio, (int, float)):
        raise DampingError(f"damping '{damping}' is not a ratio, such as 0.005 or '0.5 %'")
    return Damping(modal=ratio)


def _source(matrix: MatrixLike, temporary: Path) -> MatrixSource:
    """File of a matrix; a matrix in memory is written to a temporary file, which is read as any other."""
    if isinstance(matrix, MatrixSource):
        return matrix
    if isinstance(matrix, (str, Path)):
        return MatrixSource(Path(matrix))
    if isinstance(matrix, tuple):
        return MatrixSource(Path(matrix[0]), matrix[1])
    sp.save_npz(temporary, sp.csc_array(matrix), compressed=False)
    return MatrixSource(temporary)


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
    rule = {"modes": keep} if isinstance(keep, int) else keep
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
    """
    write_component_file(
        Path(path), component, nodes=nodes, inputs={}, outputs={}, checks=(), provenance={}, all_nodes=all_nodes
    )
    return Path(path)
