"""Files of a run for other programs: pictures, tables, mode shapes, and state-space models for MATLAB."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.assemble import elastic_states, state_space
from cmsreduce.balance import choose_coordinates, physical_states
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import DOF_NAMES, RunResult, System
from cmsreduce.pipeline.bodies import cells_of
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.report import FIGURE_NAMES, csv_tables, figure_pictures, run_pictures
from cmsreduce.write import StateSpace, atomic_path, basic_shapes, write_matlab, write_vtu

__all__ = ["export_figures", "export_pictures", "export_shapes", "export_tables", "write_system_states"]


def export_pictures(result: RunResult, folder: Path, suffix: str = ".png") -> list[Path]:
    """Pictures of a run in ``folder/pictures``."""
    to = folder / "pictures"
    to.mkdir(parents=True, exist_ok=True)
    files = [_picture(name, draw, to / f"{name}{suffix}") for name, draw in _pictures(result).items()]
    return [path for path in files if path is not None]


def export_figures(result: RunResult, folder: Path, names: Sequence[str], suffixes: Sequence[str]) -> list[Path]:
    """Single pictures of a run in ``folder/pictures``, each in every format.

    Parameters
    ----------
    result : RunResult
    folder : Path
        Run directory.
    names : sequence of str
        Of `FIGURE_NAMES`.
    suffixes : sequence of {".png", ".svg", ".pdf"}

    Raises
    ------
    ConfigError
        If there is no such picture, or the run has no data for it.
    """
    found, to = figure_pictures(result), folder / "pictures"
    for name in names:
        if name not in found:
            known = name in FIGURE_NAMES
            reason = "the run has no data for it: was it verified?" if known else "there is no such picture"
            raise ConfigError(f"--figure {name}: {reason}; this run has {', '.join(found) or 'none'}")
    to.mkdir(parents=True, exist_ok=True)
    files = [_picture(name, found[name], to / f"{name}{suffix}") for name in names for suffix in suffixes]
    return [path for path in files if path is not None]


@diagnostic("the choice of pictures", dict, required=True)
def _pictures(result: RunResult) -> dict[str, Callable[[Path], None]]:
    return run_pictures(result)


@diagnostic("the picture '{}'", about=lambda name, draw, path: path.name, required=True)
def _picture(name: str, draw: Callable[[Path], None], path: Path) -> Path | None:
    draw(path)
    return path


def export_tables(result: RunResult, folder: Path) -> list[Path]:
    """Tables of a run in ``folder/tables``, comma separated, numbers in full."""
    return [_table(rows, folder / "tables" / f"{name}.csv") for name, rows in _tables(result).items()]


@diagnostic("the tables", dict, required=True)
def _tables(result: RunResult) -> Mapping[str, Sequence[Sequence[Any]]]:
    return csv_tables(result)


def _table(rows: Sequence[Sequence[Any]], path: Path) -> Path:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    with atomic_path(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8", errors="replace")
    return path


def export_shapes(run: Run, result: RunResult, folder: Path) -> list[Path]:
    """Kept modes of every body with a geometry in ``folder/shapes``, on all its nodes, one VTU file each.

    Parameters
    ----------
    run : Run
        Its bodies.
    result : RunResult
        Its tables number the modes.
    folder : Path
        Run directory.
    """
    files = [_shapes(run, name, result, folder / "shapes" / f"{name}.vtu") for name in run.reduced_names]
    return [path for path in files if path is not None]


@diagnostic("the mode shapes of '{}'", about=lambda run, name, result, path: name, required=True)
def _shapes(run: Run, name: str, result: RunResult, path: Path) -> Path | None:
    body, modes = run.bodies[name].body, run.final[name]
    if body.nodes is None or not len(body.nodes):
        return None
    cells = cells_of(body)
    moving = np.unique(body.recovery.dofs.node[body.recovery.dofs.component > 0])
    node = np.union1d(moving, np.concatenate([moving[:0], *(corners.ravel() for corners in cells.values())]))
    node = node[body.nodes.index(node) >= 0]
    shapes = np.nan_to_num(basic_shapes(body, body.nodes, modes.Phi, node, "translation"), nan=0.0)
    number = np.sort(result.components[name].kept) + 1
    labels = [
        f"mode {k:03d}, {'static' if np.isinf(w) else f'{w / (2 * np.pi):.5g} Hz'}, {kind}"
        for k, w, kind in zip(number, modes.omega, modes.kind, strict=True)
    ]
    placed = {kind: np.searchsorted(node, corners) for kind, corners in cells.items()}
    write_vtu(path, node, body.nodes.xyz[body.nodes.index(node)], placed, labels, shapes)
    return path


def write_system_states(run: Run) -> Path:
    """Write system.mat, one structure for each configuration, and note the condition of its balanced states.

    Parameters
    ----------
    run : Run
        Its pipeline writes ``matlab``.

    Raises
    ------
    CmsReduceError
        If the system has no real state space, or fewer balanced states.
    """
    keys, model = run.pipeline.write, run.model.assembled
    states = None if keys is None else keys.balanced_states
    configurations, conditions = [], []
    for configuration in run.scene.configurations:
        system = model.system(configuration)
        described = system_states(system).variables()
        if states is not None:
            described["balanced"] = balanced_states(model, system, states)
            conditions.append(described["balanced"]["condition"])
        configurations.append(described)
    if conditions:
        run.stages.note(
            f"system.mat: balanced model of {states} states in physical coordinates; cond(P_r) is "
            f"{max(conditions):.1e} at the worst configuration, the factor by which its matrices amplify rounding"
        )
    path = run.folder / "system.mat"
    write_matlab(path, {"configuration": configurations})
    return path


def system_states(system: System) -> StateSpace:
    """State space of the assembled reduced system in one configuration.

    Raises
    ------
    MatrixError
        As `state_space` does.
    """
    model = state_space(system)
    setting = {f"{joint}.{DOF_NAMES[dof]}": value for (joint, dof), value in system.configuration.angles.items()}
    return StateSpace(
        model.A,
        model.B,
        model.C,
        model.D,
        system.inputs,
        system.outputs,
        {"name": system.configuration.name, "setting": list(setting), "value": np.array(list(setting.values()))},
    )


def balanced_states(model: AssembledModel, system: System, states: int) -> dict[str, Any]:
    """Balanced model of a system's elastic part, in displacements and rates of points of its bodies.

    Parameters
    ----------
    model : AssembledModel
        Its points are the candidates for coordinates.
    system : System
        One of its configurations.
    states : int
        Even.

    Returns
    -------
    dict of str to array, number or list of str
        A, B, C, D of the elastic part; ``coordinates``, each with its displacement in the first half of the states and
        its rate in the second; P, its ``condition``, ``hankel`` and ``bound``; ``rigid_B``, ``rigid_C1``, ``rigid_C2``
        of the rigid motions a'' = rigid_B u beside it, y = C x + D u + rigid_C1 a + rigid_C2 a'.

    Raises
    ------
    CmsReduceError
        As `physical_states`, `choose_coordinates` and `elastic_states` do.
    """
    elastic = elastic_states(system)
    stack = model.stack
    names = [
        f"{body}.{label}.{dof}"
        for body, sub in model.substructures.items()
        for label in sub.motion
        for dof in DOF_NAMES
    ]
    rows = dense(stack.spread(np.eye(stack.size)) @ system.T)
    displacements, rates = elastic.states_of(rows)
    chosen = choose_coordinates(elastic.A, elastic.B, elastic.C, displacements, rates, states)
    found = physical_states(elastic.A, elastic.B, elastic.C, np.vstack([displacements[chosen], rates[chosen]]))
    return {
        "A": found.A,
        "B": found.B,
        "C": found.C,
        "D": elastic.D,
        "coordinates": [names[k] for k in chosen],
        "P": found.P,
        "condition": found.condition,
        "hankel": found.sigma,
        "bound": found.bound,
        "rigid_B": elastic.rigid_B,
        "rigid_C1": elastic.rigid_C1,
        "rigid_C2": elastic.rigid_C2,
    }
