"""Changes of the modal matrices of a component file from its baseline, whatever basis of the modes each run found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Finding
from cmsreduce.pipeline.results.baseline_rows import common_dofs
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.verify import ModePairing, scaled_rows
from cmsreduce.write import ComponentFile

__all__ = ["matrix_findings"]

Array = NDArray[np.float64]

# Forces by rates and by displacements, with the power of the frequency in them: that of a given ratio of damping or
# loss factor.
_POWER: Mapping[str, float] = {"mass": 0.0, "damping": 1.0, "gyroscopic": 1.0, "loss": 2.0, "stiffness": 2.0}
# Ratio of damping that is round-off of a damping matrix.
_UNDAMPED = 1e-9
# Share of the largest entry of a matrix, or of all loads, that is round-off.
_ROUNDING = 1e-9
# A mode on which a matrix acts less than this share of the largest of its kind is compared with that share.
_STILL = 1e-4
# Motions of rigid or static modes that the rows of a file show by less than this share are not told apart by them.
_UNSEEN = 1e-6


def matrix_findings(
    old: ComponentFile, new: ComponentFile, pairs: ModePairing, tolerances: Tolerances
) -> Iterator[Finding]:
    """Compare modal mass, damping, geometric stiffness and what parameters add, over all modes.

    Parameters
    ----------
    old, new : ComponentFile
    pairs : ModePairing
        Of their elastic modes.
    tolerances : Tolerances

    Notes
    -----
    Elastic modes are paired; rigid and static ones are combined so that they move the dofs of both files alike.
    """
    bases = _Bases.of(old, new, pairs)
    damping = {f"modes/{name}": _POWER[name] for name in ("damping", "gyroscopic", "loss")}
    for what, limit, names in (
        ("modal mass", tolerances.integrals, {"modes/mass": 0.0}),
        ("damping", tolerances.damping, damping),
        ("geometric stiffness", tolerances.stiffness, _loads(old, new)),
        ("parameters", tolerances.stiffness, _terms(old, new)),
    ):
        known = [name for name in names if any(_matrix(file, name) is not None for file in (old, new))]
        if not known and what != "damping":
            continue
        was, now = (
            {name: bases.scaled(_matrix(file, name), T, names[name]) for name in known}
            for file, T in ((old, bases.old), (new, bases.new))
        )
        least = dict.fromkeys(known, _UNDAMPED if what == "damping" else 0.0)
        if what == "geometric stiffness":
            least = _least(was, old)
        changed = {name: _change(was[name], now[name], bases.kinds, least[name]) for name in known}
        worst = max(changed, key=lambda name: changed[name], default="")
        value = changed.get(worst, 0.0)
        yield Finding(what, value, limit, f"of {worst.rpartition('modes/')[2]}" if value else "")


def _loads(*files: ComponentFile) -> dict[str, float]:
    labels = [load for file in files for load in file.texts.get("geometric_stiffness/load", ())]
    return dict.fromkeys(labels, 2.0)


def _terms(*files: ComponentFile) -> dict[str, float]:
    paths = [path for file in files for path in file.arrays if path.startswith("parameters/")]
    return {path: _POWER[path.rpartition("/")[2]] for path in paths}


def _matrix(file: ComponentFile, name: str) -> Array | None:
    """A modal matrix (m, m), or that of a unit load; None if the file has none."""
    loads = file.texts.get("geometric_stiffness/load", ())
    if name in loads:
        return np.asarray(file.arrays["geometric_stiffness/K"][loads.index(name)])
    return file.arrays.get(name)


@dataclass(frozen=True, eq=False)
class _Bases:
    """The same motions in the modes of two files: combinations (m, k), and the frequency of each."""

    old: Array
    new: Array
    omega: Array
    kinds: NDArray[np.int64]
    """0 for rigid modes, 1 for elastic ones, 2 for static ones."""

    @classmethod
    def of(cls, old: ComponentFile, new: ComponentFile, pairs: ModePairing) -> _Bases:
        rows, rows_new = _seen(old, new)
        parts = []
        for kind in ("rigid", "static"):
            a, b = (_columns(file, kind) for file in (old, new))
            parts.append(_alike(rows[:, a], rows_new[:, b], a, b, old.omega.size, new.omega.size))
        elastic = np.eye(old.omega.size)[:, old.rigid_count + pairs.old]
        elastic_new = np.eye(new.omega.size)[:, new.rigid_count + pairs.new] @ pairs.turn
        (rigid, rigid_new), (static, static_new) = parts
        omega = old.omega[old.rigid_count + pairs.old]
        lowest = float(old.omega[old.elastic].min(initial=np.inf))
        lowest = lowest if np.isfinite(lowest) else 1.0
        ends = [np.full(part.shape[1], lowest) for part in (rigid, static)]
        return cls(
            np.hstack([rigid, elastic, static]),
            np.hstack([rigid_new, elastic_new, static_new]),
            np.concatenate([ends[0], omega, ends[1]]),
            np.repeat([0, 1, 2], [rigid.shape[1], omega.size, static.shape[1]]),
        )

    def scaled(self, A: Array | None, T: Array, power: float) -> Array:
        """A matrix of one file as ratios of damping, or shares of the stiffness, of these motions; zero if absent."""
        # Modes of unit mass, and static ones of unit stiffness.
        scale = self.omega ** np.where(self.kinds == 2, 1 - power / 2, -power / 2)
        return np.zeros((scale.size,) * 2) if A is None else scale[:, None] * (T.T @ A @ T) * scale


def _change(old: Array, new: Array, kinds: NDArray[np.int64], least: float) -> float:
    """Largest change of a matrix, relative to what it does between both modes of an entry and all of their kinds."""
    worst, least = 0.0, max(least, _ROUNDING * float(abs(old).max(initial=0.0)), float(np.sqrt(np.finfo(float).tiny)))
    for one in np.unique(kinds):
        for other in np.unique(kinds):
            block = np.ix_(kinds == one, kinds == other)
            sizes = [np.linalg.norm(old[block], axis=axis) for axis in (1, 0)]
            rows, columns = (np.maximum(size, max(_STILL * float(size.max()), least)) for size in sizes)
            worst = max(worst, float((abs(new - old)[block] / np.sqrt(np.outer(rows, columns))).max()))
    return worst


def _least(loads: Mapping[str, Array], file: ComponentFile) -> dict[str, float]:
    """Rounding of the stiffness of each unit load: a load that stresses nothing leaves it, another in each run."""
    rigid = file.arrays.get("integrals/rigid_mass", np.eye(6))
    mass = float(rigid.diagonal()[:3].max()) or 1.0
    length = float(np.sqrt(rigid.diagonal()[3:].max() / mass)) or 1.0
    # The load of each kind that a force of one unit makes at a distance of one length.
    worth = {"acceleration": 1 / mass, "force": 1.0, "moment": length}
    each = {name: worth.get(name.rpartition(" ")[0], 1 / (mass * length)) for name in loads}
    largest = max((each[name] * float(abs(A).max(initial=0.0)) for name, A in loads.items()), default=0.0)
    return {name: _ROUNDING * largest / per_force for name, per_force in each.items()}


def _columns(file: ComponentFile, kind: str) -> NDArray[np.int64]:
    every = np.arange(file.omega.size)
    return every[: file.rigid_count] if kind == "rigid" else every[file.elastic.stop :]


def _seen(old: ComponentFile, new: ComponentFile) -> tuple[Array, Array]:
    """Rows of both files over their modes that show the same: dofs, and momenta where both have them."""
    i, j, kind = common_dofs(old, new)
    rows, rows_new = [old.arrays["dofs/shapes"][i]], [new.arrays["dofs/shapes"][j]]
    for number, name in enumerate(("int_phi", "int_r_x_phi")):
        key = f"integrals/{name}"
        if key in old.arrays and key in new.arrays:
            rows.append(old.arrays[key])
            rows_new.append(new.arrays[key])
            kind = np.concatenate([kind, np.full(3, 2 + number)])
    return scaled_rows(np.vstack(rows), np.vstack(rows_new), kind)


def _alike(
    rows: Array, rows_new: Array, a: NDArray[np.int64], b: NDArray[np.int64], m: int, m_new: int
) -> tuple[Array, Array]:
    """Combinations of modes a of one file and b of the other that move the rows alike, in either (m, k)."""
    found, found_new = np.zeros((m, 0)), np.zeros((m_new, 0))
    # Another number of modes has a line of its own.
    if a.size != b.size or not a.size or not rows.size:
        return found, found_new
    U, s, Vt = np.linalg.svd(rows, full_matrices=False)
    k = int(np.count_nonzero(s > _UNSEEN * s[0]))
    found, found_new = np.zeros((m, k)), np.zeros((m_new, k))
    found[a] = Vt[:k].T
    found_new[b] = np.linalg.lstsq(rows_new, U[:, :k] * s[:k], rcond=_UNSEEN)[0]
    return found, found_new
