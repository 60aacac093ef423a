"""Limits of a check from a file, from the command line, and from the result itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from cmsreduce.config import RELATIVE_ERRORS, Entry, parse, parse_decibels, parse_ratio
from cmsreduce.errors import ConfigError, ReadError, UnitsError, closest, not_among, refuse_device
from cmsreduce.model import Finding

__all__ = ["Limits", "Tolerances", "limited", "read_limits"]

_FORM = ": write KEY=VALUE with a finite number, such as {}"


@dataclass(frozen=True)
class Tolerances:
    """Largest allowed changes of a result from its baseline.

    Parameters
    ----------
    frequency : float
        Relative shift of a natural frequency, of a kept mode or of the system. 1e-4 costs one per cent of the response
        at 0.5 % damping; two machines agree to 1e-8.
    shape : float
        1 - MAC of a kept mode.
    mass : float
        Relative change of the mass; of the centre of mass in radii of gyration; of the inertia, relative to its largest
        moment.
    flexibility : float
        Change of the static flexibility at the dofs of the file, relative to that of each dof of a pair.
    channels : float
        Change of a row of inputs or outputs, relative to its size, the root of its static flexibility.
    integrals : float
        Change of a modal integral, relative to the largest value that the body's mass allows for it.
    damping : float
        Change of damping ratios, loss factors and gyroscopic forces of kept modes, relative to the largest.
    stiffness : float
        Change of geometric stiffness and of what parameters add, relative to what each does to the modes of an entry.
    geometry : float
        Change of a place, relative to the size of the body, and of a direction.
    modes : float
        Kept modes lost and gained.
    errors : float
        Growth of an error of the run, absolute; unlimited by default, as the run has limits of its own.
    """

    frequency: float = 1e-4
    shape: float = 1e-2
    mass: float = 1e-6
    flexibility: float = 1e-3
    channels: float = 1e-3
    integrals: float = 1e-3
    damping: float = 1e-3
    stiffness: float = 1e-3
    geometry: float = 1e-6
    modes: float = 0.0
    errors: float = math.inf


@dataclass(frozen=True)
class Limits:
    """Largest values allowed.

    Parameters
    ----------
    maxima : mapping of figure to (float, str)
        Limit, and the place where it is written. A figure is named alone, for all components, or as
        ``rotor.kept_modes``.
    tolerances : Tolerances
        For the comparison with a baseline.
    """

    maxima: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    tolerances: Tolerances = field(default_factory=Tolerances)


def read_limits(file: Path | None, maxima: Sequence[str] = (), tolerances: Sequence[str] = ()) -> Limits:
    """Read limits from a file and from the command line, which wins.

    Parameters
    ----------
    file : Path, optional
        YAML of ``max:`` (figure: value, or component: {figure: value}) and ``tolerance:`` (of a baseline).
    maxima, tolerances : sequence of str
        ``KEY=VALUE`` each, as given to ``--max`` and ``--tolerance``.

    Raises
    ------
    ReadError
        If the file is missing or cannot be read.
    ConfigError
        If a key is unknown or a value is not a number, with the place.
    """
    limits = Limits() if file is None else _from_file(file)
    found = dict(limits.maxima)
    for text in maxima:
        key, value = _pair(text)
        example = "db_error=1" if key.endswith("db_error") else "frf_error=0.05"
        found[key] = (_maximum(key, value, f"--max {text}", _FORM.format(example)), f"--max {key}")
    chosen = limits.tolerances
    for text in tolerances:
        key, value = _pair(text)
        if not isinstance(value, float):
            raise ConfigError(f"--tolerance {text}{_FORM.format('frequency=1e-3')}")
        chosen = _tolerance(chosen, key, value, f"--tolerance {key}")
    return Limits(found, chosen)


def limited(findings: Sequence[Finding], limits: Limits, unlisted: Sequence[Finding], where: Path) -> list[Finding]:
    """Apply limits to findings.

    Parameters
    ----------
    findings : sequence of Finding
        With their stored limits, which the limits of the check replace.
    limits : Limits
        Limits of the check. A figure named with its component wins over the figure alone.
    unlisted : sequence of Finding
        Figures that are shown only with a limit: sizes, wall times.
    where : Path
        Checked path, for messages.

    Raises
    ------
    ConfigError
        If a limit is on a figure that does not exist.
    """
    every = [*findings, *unlisted]
    names = {name for found in every for name in _names(found)}
    for key, (_, written) in limits.maxima.items():
        if key not in names:
            figures = list(dict.fromkeys(found.name for found in every))
            meant = closest(key, names)
            guess = f", did you mean '{meant}'?" if meant else "."
            raise ConfigError(
                f"{written}: there is no such figure in {where}{guess} There are: {', '.join(figures)}; one of a "
                "component is COMPONENT.FIGURE"
            )
    result = [_with_limit(found, limits) for found in findings]
    return result + [found for each in unlisted if (found := _with_limit(each, limits)).judged]


def _with_limit(found: Finding, limits: Limits) -> Finding:
    for name in reversed(_names(found)):
        if name in limits.maxima:
            return replace(found, limit=limits.maxima[name][0])
    return found


def _names(found: Finding) -> list[str]:
    """Names under which a limit may be given, the most specific last."""
    own = [f"{found.subject}.{found.name}", found.label] if found.subject else []
    return [found.name, *own]


def _pair(text: str) -> tuple[str, float | str]:
    """Key and value of KEY=VALUE; a value that is no number stays text."""
    key, _, value = text.rpartition("=")
    try:
        number = float(value)
    except ValueError:
        return key.strip(), value
    return key.strip(), value if math.isnan(number) else number


def _maximum(name: str, value: object, where: str, wanted: str) -> float:
    """Limit as a number: of a relative error a fraction, or per cent with their sign; decibels may have their unit."""
    if name.rpartition(".")[2] == "db_error":
        value = parse_decibels(value)
    if name.rpartition(".")[2] in RELATIVE_ERRORS:
        try:
            value = parse_ratio(value)
        except UnitsError as error:
            raise ConfigError(f"{where}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ConfigError(f"{where}{wanted}")
    return float(value)


def _from_file(path: Path) -> Limits:
    refuse_device(path)
    try:
        root = parse(path.read_text(encoding="utf-8-sig"), str(path), path.parent)
    except OSError as error:
        raise ReadError(f"{path}: the limits cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: this is not UTF-8 text: save the file as UTF-8") from None
    if not isinstance(root.value, dict):
        raise ConfigError(f"{path}: limits are a mapping, such as 'max: {{frf_error: 0.05}}'")
    maxima: dict[str, tuple[float, str]] = {}
    tolerances = Tolerances()
    for key, entry in root.value.items():
        if key == "max":
            maxima = {
                name: (_maximum(name, value, where, " needs a number"), where)
                for name, value, where in _figures(entry, "")
            }
        elif key == "tolerance":
            for name, value, where in _figures(entry, ""):
                if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
                    raise ConfigError(f"{where} needs a number")
                tolerances = _tolerance(tolerances, name, value, where)
        else:
            raise ConfigError(f"{entry.where}: {not_among('key', key, ('max', 'tolerance'))}")
    return Limits(maxima, tolerances)


def _figures(entry: Entry, component: str) -> Iterator[tuple[str, object, str]]:
    """Name, value and place of every limit below a key."""
    if not isinstance(entry.value, dict):
        raise ConfigError(f"{entry.where}: figures and their limits are expected here, such as 'frf_error: 0.05'")
    for key, item in entry.value.items():
        name = f"{component}.{key}" if component else key
        if isinstance(item.value, dict) and not component:
            yield from _figures(item, key)
        else:
            yield name, item.value, f"{item.where}: '{name}'"


def _tolerance(tolerances: Tolerances, key: str, value: float, where: str) -> Tolerances:
    known = [each.name for each in fields(Tolerances)]
    if key not in known:
        raise ConfigError(f"{where}: {not_among('tolerance', key, known)}")
    return replace(tolerances, **{key: float(value)})
