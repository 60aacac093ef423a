"""Simscape Multibody: arrays of its block Reduced Order Flexible Solid, and the script that loads and checks them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import of_one_stem, put_lines
from cmsreduce.write.targets.state_space import write_matlab
from cmsreduce.write.targets.superelement import Superelement, framed_superelement

__all__ = ["SIMSCAPE_MARK", "simscape_files", "write_simscape"]

SIMSCAPE_MARK = "% Reduced Order Flexible Solid of "
"""Beginning of the script."""

_SIX = 6
# The rigid motions of the block must cost no energy. Shapes are known to about nine digits.
_STRAINED = 1e-6
# Of a motion's mass, each row scaled to one: what round-off leaves where there is none.
_INERT = 1e-12

Array = NDArray[np.float64]


def simscape_files(path: Path) -> tuple[Path, ...]:
    """Script and data of one stem: that of the path, made a name that MATLAB can run."""
    script, data = of_one_stem(path, ".m", ".mat")
    stem = re.sub(r"\W", "_", script.stem, flags=re.ASCII)
    stem = stem if stem[:1].isalpha() else f"m{stem}"
    return script.with_stem(stem), data.with_stem(stem)


def write_simscape(path: Path, component: ComponentFile) -> tuple[Path, ...]:
    """Write a body for Simscape's Reduced Order Flexible Solid: a script ``.m`` and its data ``.mat`` of one stem.

    The data are in SI: P (frames, 3) origins and Q (frames, 4) unit quaternions, scalar first, of the interface frames
    in the basic frame; K, M and D with the rows x y z rx ry rz of each frame along the basic axes, then one row for
    each fixed-interface mode.

    Parameters
    ----------
    path : Path
        Name of the script, in which other characters than letters, digits and _ become _; each file is complete or
        absent.
    component : ComponentFile
        The body.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    WriteError
        If the body is not free in all six directions, has no interface of six dofs at a node, a motion of the interface
        moves no mass, damping is a complex stiffness, or a file cannot be written.
    """
    if component.rigid_count != _SIX:
        raise WriteError(
            f"component '{component.name}': the block needs a body with six motions without strain, and this one has "
            f"{component.rigid_count}; reduce the body without supports, and hold it in the Simscape model"
        )
    body = framed_superelement(component)
    frames = _frames(component, body)
    _require_rigid_motions(component, body, frames["P"])
    _require_mass(component, body)
    none = np.zeros_like(body.K)
    data = {
        **frames,
        "K": body.K,
        "M": body.M,
        "D": none if body.D is None else body.D,
        "frequency_hz": body.omega / (2 * np.pi),
        "name": component.name,
    }
    script, arrays = simscape_files(path)
    # First the file with the mark, as for NASTRAN.
    put_lines(script, _script(component.name, arrays.name, frames))
    write_matlab(arrays, data)
    return script, arrays


def _frames(component: ComponentFile, body: Superelement) -> dict[str, Array | list[str]]:
    """Origins in metres, quaternions and interfaces of the nodes, in the order of the rows."""
    nodes, faces = body.interface.node[::_SIX], component.interfaces
    at = [int(np.flatnonzero(component.arrays["nodes/id"] == node)[0]) for node in nodes]
    names = [[name for name, ids in faces.items() if node in ids] for node in nodes]
    axes = np.array([component.arrays[f"interfaces/{first}/frame"] for first, *_ in names])
    # The axes are the rows; a rotation matrix has them as columns.
    # To load rotations takes longer than most commands that write no such file.
    from scipy.spatial.transform import Rotation

    vector_first = Rotation.from_matrix(np.swapaxes(axes, 1, 2)).as_quat(canonical=True)
    return {
        "P": component.arrays["nodes/xyz"][at] * component.units.length,
        "Q": np.roll(vector_first, 1, axis=1),
        # One frame serves all interfaces of a node, along the axes of the first.
        "frames": [" and ".join(f"{name}.{node}" for name in own) for own, node in zip(names, nodes, strict=True)],
    }


def _require_rigid_motions(component: ComponentFile, body: Superelement, origins: Array | list[str]) -> None:
    """Refuse a stiffness that resists rigid motions of the frames, as of nodes that are elsewhere than they say."""
    i = len(body.interface)
    R = np.zeros((i, _SIX))
    for row, (x, y, z) in zip(range(0, i, _SIX), np.asarray(origins), strict=True):
        R[row : row + _SIX] = np.eye(_SIX)
        R[row : row + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    force, scale = body.K[:i, :i] @ R, abs(body.K[:i, :i]) @ abs(R)
    strained = abs(force).max() / max(scale.max(), np.finfo(float).tiny)
    if strained > _STRAINED:
        raise WriteError(
            f"component '{component.name}': its interface stiffness resists rigid motions of the frames by "
            f"{strained:.1e} of its size, and the block needs zero; check the positions of the interface nodes"
        )


def _require_mass(component: ComponentFile, body: Superelement) -> None:
    """Refuse a mass matrix that is not positive definite, as of interface nodes that turn without inertia."""
    size = np.sqrt(np.diagonal(body.M))
    resting = np.flatnonzero(size <= 0)
    least = -np.inf if resting.size else la.eigvalsh(body.M / np.outer(size, size))[0]
    if least <= _INERT:
        raise WriteError(
            f"component '{component.name}': a motion of its interface moves no mass, and the block needs a mass matrix "
            "that is positive definite; give the interface nodes some inertia, or keep more modes"
        )


def _script(name: str, arrays: str, frames: dict[str, Array | list[str]]) -> Iterator[str]:
    """MATLAB script that loads the data, checks what the block requires, and says where each array goes."""
    labels = list(frames["frames"])
    yield f"{SIMSCAPE_MARK}{name}. Parameters of the block:"
    yield f"%   Number of Frames {len(labels)}: {', '.join(f'F{n} {label}' for n, label in enumerate(labels, 1))}"
    yield "%   Origins rom.P (m)   Orientations rom.Q (in releases that have them; else use Rigid Transform blocks)"
    yield "%   Stiffness Matrix rom.K   Mass Matrix rom.M   Damping: Damping Matrix rom.D   Units: m, kg, s"
    yield f"rom = load(fullfile(fileparts(mfilename('fullpath')), '{arrays}'));"
    yield "n = 6 * size(rom.P, 1);"
    yield "m = size(rom.K, 1);"
    yield "assert(isequal(size(rom.K), size(rom.M), size(rom.D)) && m >= n, 'matrices of one size')"
    yield "assert(isequal(rom.K, rom.K') && isequal(rom.M, rom.M') && isequal(rom.D, rom.D'), 'symmetric matrices')"
    yield "assert(all(eig(rom.M) > 0), 'a mass matrix that is positive definite')"
    yield "rom.squares = sort(abs(eig(rom.K, rom.M)));"
    yield "assert(m == 6 || rom.squares(6) < 1e-6 * rom.squares(7), 'six motions without strain')"
    yield "fprintf('%s: %d interface frames, %d modes, first elastic frequency %g Hz\\n', rom.name, n / 6, m - n, ..."
    yield "    sqrt(min(rom.squares(7:end))) / (2 * pi));"
