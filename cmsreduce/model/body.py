"""Bodies as they come from a finite-element code, and the interfaces at which they are joined."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError, SceneError
from cmsreduce.model.damping import Damping
from cmsreduce.model.dofs import SCALAR, DofTable, Nodes, rigid_body_shapes
from cmsreduce.model.integrals import SecondOrder
from cmsreduce.model.parameters import ParameterTerm, Values, varied
from cmsreduce.model.rounding import DOUBLE
from cmsreduce.model.sound_matrix import checked_matrix
from cmsreduce.model.units import SI, Units

__all__ = ["FEModel", "Interface", "Recovery", "Source", "UntiedMass"]

_TRANSLATIONS = 3
# Share of the nodes with rows up to which nodes without rows may be spare ones.
_SPARE = 0.1


@dataclass(frozen=True, eq=False)
class Recovery:
    """Dofs that follow other dofs: x = T x_leads.

    Parameters
    ----------
    dofs : DofTable
        k dofs.
    leads : DofTable
        i dofs that they follow: the rows of a body, or dofs of its deck.
    T : (k, i) sparse array
        Motion of each dof under unit motion of each lead.

    Raises
    ------
    DofMapError
        If the sizes disagree.
    """

    dofs: DofTable
    leads: DofTable
    T: sp.csr_array

    def __post_init__(self) -> None:
        T = sp.csr_array(self.T)
        if T.shape != (len(self.dofs), len(self.leads)):
            raise DofMapError(f"{len(self.dofs)} dofs follow {len(self.leads)} others, but their matrix is {T.shape}")
        object.__setattr__(self, "T", T)


@dataclass(frozen=True, eq=False)
class UntiedMass:
    """Mass matrix of a body over the dofs that it was read with.

    After a tie a row is no longer the motion of one place along one axis. Integrals over the body, and masses gathered
    at its nodes, need this matrix.

    Parameters
    ----------
    dofs : DofTable
        g dofs.
    M : (g, g) sparse array
        Mass.
    """

    dofs: DofTable
    M: sp.csc_array


@dataclass(frozen=True, eq=False)
class Interface:
    """Named dofs of a body to which joints attach (the i-set, or a part of it).

    Parameters
    ----------
    name : str
        Name of the interface, unique in its body.
    node : (p,) int64
        Node ids; joints pair the nodes of two interfaces in this order.
    components : tuple of (tuple of int)
        Components 1..6 of each node that belong to the interface, along its displacement frame.
    position : (p, 3) float64
        Coordinates of the nodes in the body's basic frame, in the body's unit of length.
    frame : (3, 3) float64
        Axes of the interface, and of a joint on it, as rows in basic components.
    node_axes : (p, 3, 3) float64, optional
        Displacement frames of the nodes as rows, in basic components; ``frame`` for every node if absent.
    """

    name: str
    node: NDArray[np.int64]
    components: tuple[tuple[int, ...], ...]
    position: NDArray[np.float64]
    frame: NDArray[np.float64]
    node_axes: NDArray[np.float64] | None = None

    def node_frame(self, k: int) -> NDArray[np.float64]:
        """Displacement axes of node k (3, 3), along which its components are."""
        return self.frame if self.node_axes is None else np.asarray(self.node_axes[k])


@dataclass(frozen=True)
class Source:
    """A file that a body was read from.

    Parameters
    ----------
    path : str
        Path as given by the user.
    sha256 : str
        Hash of its bytes.
    holds : str
        Content that was used, such as ``stiffness KAA``.
    """

    path: str
    sha256: str
    holds: str


@dataclass(frozen=True, eq=False)
class FEModel:
    """An unreduced body: M x'' + D x' + K x = f (theory section 1).

    Parameters
    ----------
    name : str
        Name of the body.
    K, M : (n, n) sparse array
        Stiffness and mass, symmetric, in ``units``; rows as in ``dofs``.
    dofs : DofTable
        Node and component of each row.
    nodes : Nodes, optional
        Coordinates and displacement frames; absent for bodies of scalar dofs only.
    interfaces : mapping of name to Interface
        Interfaces, at which joints attach.
    damping : Damping
        Damping law.
    D : (n, n) sparse array, optional
        Viscous damping matrix, instead of a damping law.
    units : Units
        Unit system of matrices and coordinates.
    rounding : float
        Relative rounding of the numbers in the matrix file (1.1e-16 double, 6e-8 single, 5e-11 for ten digits).
    noise : float
        Error of K relative to sqrt(K_ii K_jj) that is not the rounding of its entries, as measured on rigid motion:
        larger parts cancelled, such as in condensation.
    sets : mapping of str to (k,) int64
        Rows of named dof sets of the source, such as ``b`` and ``q``.
    constrained : DofTable
        Dofs held at zero by single-point constraints of the source, or because their motion is undetermined; they have
        no rows.
    tied : Recovery, optional
        Dofs that follow the rows, such as those of nodes tied to an interface point; they have no rows.
    untied_mass : UntiedMass, optional
        Mass over the dofs that the body was read with, if some of them are tied: M = T^T M_untied T.
    second_order : SecondOrder, optional
        Integrals of second order over unit motions of the rows, about the basic origin and along the basic axes, where
        the source states them: mass that moves with generalised coordinates does not determine them.
    grounded : bool
        True if the user states that the body is held to the ground, so that K resists rigid motion.
    rows_trusted : bool
        True if the user vouches for the order of the rows where it cannot be proven.
    sources : tuple of Source
        Files that the body was read from.
    remarks : tuple of str
        What was changed in reading it, with figures.
    terms : tuple of ParameterTerm
        What parameters of the scene add to its matrices, and gyroscopic matrices, which are added to its damping.
    corners : tuple of mapping of parameter to float
        Values of the parameters at which its mode sets are computed, beside the body as it is without parameters.

    Raises
    ------
    MatrixError
        If sizes disagree, an entry is not finite, or a matrix is not symmetric to the body's rounding or has a
        negative diagonal.
    """

    name: str
    K: sp.csc_array
    M: sp.csc_array
    dofs: DofTable
    nodes: Nodes | None = None
    interfaces: Mapping[str, Interface] = field(default_factory=dict)
    damping: Damping = field(default_factory=Damping)
    D: sp.csc_array | None = None
    units: Units = SI
    rounding: float = DOUBLE
    noise: float = 0.0
    sets: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    constrained: DofTable | None = None
    tied: Recovery | None = None
    untied_mass: UntiedMass | None = None
    second_order: SecondOrder | None = None
    grounded: bool = False
    rows_trusted: bool = False
    sources: tuple[Source, ...] = ()
    remarks: tuple[str, ...] = ()
    terms: tuple[ParameterTerm, ...] = ()
    corners: tuple[Values, ...] = ()
    # Matrices that were checked already: `dataclasses.replace` hands them on, and a large one takes as long to check as
    # to read.
    _sound: tuple[sp.csc_array, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        n = len(self.dofs)
        for letter, what in (("K", "stiffness"), ("M", "mass"), ("D", "damping")):
            A = getattr(self, letter)
            if A is not None and not any(A is sound and A.shape[0] == n for sound in self._sound):
                where = f"body '{self.name}': {what} matrix {letter}"
                object.__setattr__(self, letter, checked_matrix(A, self.dofs, where, self.rounding))
        object.__setattr__(self, "_sound", tuple(A for A in (self.K, self.M, self.D) if A is not None))
        if self.tied is not None and self.tied.T.shape[1] != n:
            raise DofMapError(f"body '{self.name}': tied dofs follow {self.tied.T.shape[1]} rows, but it has {n}")
        if self.second_order is not None and self.second_order.phi_phi.shape != (3, 3, n, n):
            raise DofMapError(f"body '{self.name}': integrals of {self.second_order.phi_phi.shape[2]} rows, not of {n}")
        if self.D is not None and self.damping.law != "none":
            raise MatrixError(f"body '{self.name}': give a damping matrix or a damping law, not both")
        if self.nodes is not None:
            moving = self.dofs.component != SCALAR
            lost = np.unique(self.dofs.node[moving][self.nodes.index(self.dofs.node[moving]) < 0])
            if lost.size:
                raise DofMapError(
                    f"body '{self.name}': {lost.size} nodes have rows in the matrices but no coordinates in the "
                    f"geometry, the first is {lost[0]}; check that deck and matrices are of one model"
                )

    def __repr__(self) -> str:
        return f"<FEModel {self.name}: {self.n} dofs, {len(self.interfaces)} interfaces>"

    def named(self, name: str) -> FEModel:
        """The same body under another name; it shares the matrices."""
        # A new instance would check and copy them again.
        found = copy(self)
        object.__setattr__(found, "name", name)
        return found

    def undamped_at(self, values: Values) -> FEModel:
        """The body at some values of the parameters, without its damping; itself where they add nothing."""
        acting = [term for term in self.terms if term.letter in "KM" and term.factor(values)]
        if not acting:
            return self
        K, M = (varied(getattr(self, letter), acting, letter, values) for letter in ("K", "M"))
        assert isinstance(K, sp.csc_array) and isinstance(M, sp.csc_array)
        untied = None if any(term.letter == "M" for term in acting) else self.untied_mass
        return replace(self, K=K, M=M, D=None, damping=Damping(), terms=(), corners=(), untied_mass=untied)

    @property
    def n(self) -> int:
        """Number of dofs."""
        return len(self.dofs)

    @property
    def stiffness_rounding(self) -> float:
        """Relative error of K by any source."""
        return max(self.rounding, self.noise)

    @property
    def nodes_without_rows(self) -> NDArray[np.int64]:
        """Numbers of the nodes without rows that are not held in all translations: condensed ones, or spare ones."""
        if self.nodes is None:
            return np.empty(0, dtype=np.int64)
        known = self.dofs.node
        if self.constrained is not None:
            moves = (self.constrained.component > 0) & (self.constrained.component <= _TRANSLATIONS)
            held, count = np.unique(self.constrained.node[moves], return_counts=True)
            known = np.concatenate([known, held[count == _TRANSLATIONS]])
        return self.nodes.id[~np.isin(self.nodes.id, known)]

    @property
    def keeps_its_nodes(self) -> bool:
        """True if its nodes have rows or are held, but for a few that may be spare, such as those that orient bars."""
        return self.nodes_without_rows.size <= _SPARE * self.dofs.node_ids.size

    @cached_property
    def rigid_shapes(self) -> NDArray[np.float64]:
        """Displacements (n, 6) under unit rigid motions, about the mean of the nodes; not to be changed in place."""
        if self.nodes is None:
            raise DofMapError(f"body '{self.name}' has no geometry, which shows its rigid motions")
        return rigid_body_shapes(self.dofs, self.nodes, self.nodes.xyz.mean(axis=0))

    @cached_property
    def rigid_momentum(self) -> NDArray[np.float64]:
        """Momentum (n, 6) of the unit rigid motions of `rigid_shapes`; not to be changed in place."""
        return np.asarray(self.M @ self.rigid_shapes)

    @cached_property
    def recovery(self) -> Recovery:
        """Every dof with a known motion: the rows themselves, then the dofs tied to them."""
        rows = sp.eye_array(self.n, format="csr")
        if self.tied is None:
            return Recovery(self.dofs, self.dofs, rows)
        return Recovery(self.dofs.joined(self.tied.dofs), self.dofs, sp.csr_array(sp.vstack([rows, self.tied.T])))

    def interface_rows(self, name: str) -> NDArray[np.int64]:
        """Rows of one interface, node by node."""
        if name not in self.interfaces:
            known = ", ".join(self.interfaces) or "none"
            raise SceneError(f"body '{self.name}' has no interface '{name}' (it has: {known})")
        face = self.interfaces[name]
        pairs = zip(face.node, face.components, strict=True)
        return np.concatenate([self.dofs.rows_of(int(node), parts) for node, parts in pairs])
