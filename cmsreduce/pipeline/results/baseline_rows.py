"""Changes of a component file from its baseline at dofs and channels: static flexibility, inputs and outputs."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Finding
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.verify import ModePairing
from cmsreduce.write import ComponentFile

__all__ = ["common_dofs", "lost_or_new", "row_findings"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# A dof that moves less than this share of the largest of its kind is compared with that share: modes of two machines
# agree to 1e-8 of their largest motion.
_STILL = 1e-4
# A channel this far below the dofs is rounding of one that does not act on the body, or not on its rigid motion.
_SILENT = 1e-9


def common_dofs(old: ComponentFile, new: ComponentFile) -> tuple[Indices, Indices, Indices]:
    """Rows of ``dofs/shapes`` in the old and in the new file that are one dof, and their kind: 1 for rotations."""
    keys = [file.arrays["dofs/node"] * 8 + file.arrays["dofs/component"] for file in (old, new)]
    _, i, j = np.intersect1d(*keys, return_indices=True)
    return i, j, (old.arrays["dofs/component"][i] > 3).astype(np.int64)


def lost_or_new(what: str, old: Collection[str], new: Collection[str]) -> Finding:
    """Names that one of two results has alone; none may be."""
    gone, come = (sorted(set(a) - set(b)) for a, b in ((old, new), (new, old)))
    words = "; ".join(f"{how} {', '.join(names)}" for how, names in (("lost", gone), ("new", come)) if names)
    return Finding(f"{what} lost or new", float(len(gone) + len(come)), 0.0, words)


def row_findings(
    old: ComponentFile, new: ComponentFile, pairs: ModePairing, tolerances: Tolerances
) -> Iterator[Finding]:
    """Compare the static flexibility at dofs, and the rows of inputs and outputs over all modes.

    Parameters
    ----------
    old, new : ComponentFile
    pairs : ModePairing
        Of their elastic modes.
    tolerances : Tolerances

    Notes
    -----
    Rows are divided by w in elastic modes, so that products of them, summed over the modes that deform the body, are
    static flexibilities. The size of a row is the root of its product with itself. Sums over the rigid or the static
    modes do not depend on the basis that a run found for these. Shifts of frequencies have a tolerance of their own:
    paired modes have the old one.
    """
    omega = old.omega[old.elastic], new.omega[new.elastic].copy()
    omega[1][pairs.new] = omega[0][pairs.old]
    i, j, kind = common_dofs(old, new)
    D, D_new = (
        _split(file, w, file.arrays["dofs/shapes"][at]) for file, w, at in zip((old, new), omega, (i, j), strict=True)
    )
    flexibility, flexibility_new = (E @ E.T + S @ S.T for _, E, S in (D, D_new))
    soft, least_soft = _sizes(np.hstack(D[1:]), kind)
    change = abs(flexibility_new - flexibility) / np.outer(soft, soft)
    value = float(change.max(initial=0.0))
    at = old.texts["dofs/label"][i[change.max(axis=1).argmax()]] if value else ""
    yield Finding("static flexibility", value, tolerances.flexibility, f"above all at {at}" if at else "")
    for what in ("inputs", "outputs"):
        yield lost_or_new(what, old.texts[f"{what}/name"], new.texts[f"{what}/name"])
    rows, rows_new = (_channels(file) for file in (old, new))
    names = [name for name in rows if name in rows_new]
    if not names:
        return
    L, L_new = (
        _split(file, w, np.array([found[name] for name in names]))
        for file, w, found in zip((old, new), omega, (rows, rows_new), strict=True)
    )
    own = np.maximum(np.linalg.norm(np.hstack(L[1:]), axis=1), least_soft)
    carried, least_carried = _sizes(D[0], kind)
    own_carried = np.maximum(np.linalg.norm(L[0], axis=1), least_carried)
    # Products with the dofs, too: they show the sign of an input that no output of the body sees.
    rigid, static = (np.hstack([L_new[k] @ L_new[k].T, L_new[k] @ D_new[k].T]) for k in (0, 2))
    rigid -= np.hstack([L[0] @ L[0].T, L[0] @ D[0].T])
    static -= np.hstack([L[2] @ L[2].T, L[2] @ D[2].T])
    elastic = L_new[1][:, pairs.new] @ pairs.turn - L[1][:, pairs.old]
    changes = {
        "elastic": abs(elastic) / own[:, None],
        "static": abs(static) / np.outer(own, np.concatenate([own, soft])),
        "rigid": abs(rigid) / np.outer(own_carried, np.concatenate([own_carried, carried])),
    }
    each = {modes: change.max(axis=1, initial=0.0) for modes, change in changes.items()}
    worst = max(each, key=lambda modes: float(each[modes].max()))
    value = float(each[worst].max())
    note = f"of {names[int(each[worst].argmax())]} in the {worst} modes" if value else ""
    yield Finding("inputs and outputs", value, tolerances.channels, note)


def _split(file: ComponentFile, omega: Array, rows: Array) -> tuple[Array, Array, Array]:
    """Rows over the rigid, the elastic and the static modes; the elastic ones divided by w."""
    e = file.elastic
    return rows[:, : e.start], rows[:, e] / omega, rows[:, e.stop :]


def _sizes(rows: Array, kind: Indices) -> tuple[Array, float]:
    """Sizes of the rows of dofs, none much below the largest of its kind, and the least size of a channel."""
    size = np.linalg.norm(rows, axis=1)
    largest = np.array([size[kind == k].max(initial=0.0) for k in (0, 1)])
    # Of a body without such motions every change is beyond all limits; the square of this number is not zero.
    tiny = float(np.sqrt(np.finfo(float).tiny))
    return np.maximum(size, np.maximum(_STILL * largest[kind], tiny)), max(
        _SILENT * min((each for each in largest if each > 0), default=0.0), tiny
    )


def _channels(file: ComponentFile) -> dict[str, Array]:
    """Rows of inputs and outputs over all modes, by what they are."""
    found = {
        f"input {name}": row for name, row in zip(file.texts["inputs/name"], file.arrays["inputs/B"].T, strict=True)
    }
    for part, word in (("C1", "output"), ("C2", "rate of output")):
        rows = zip(file.texts["outputs/name"], file.arrays[f"outputs/{part}"], strict=True)
        found |= {f"{word} {name}": row for name, row in rows}
    return found
