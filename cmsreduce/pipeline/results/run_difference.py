"""Differences between two runs, from their summaries."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import ReadError
from cmsreduce.read import expect_kind, file_kind
from cmsreduce.write import read_summary

__all__ = ["DifferenceRow", "run_difference"]

_COMPONENT = ("method", "full_dofs", "basis_size", "elastic_modes", "kept_modes")
_SPEED = ("reduce_s", "full_frf_s", "reduced_frf_s")


@dataclass(frozen=True)
class DifferenceRow:
    """One figure of two runs.

    Parameters
    ----------
    what : str
        Such as ``rotor: kept_modes``.
    a, b : float, int, str, bool or None
        None for a run without this figure.
    """

    what: str
    a: float | int | str | bool | None
    b: float | int | str | bool | None

    @property
    def same(self) -> bool:
        """True if the values are equal."""
        return self.a == self.b

    @property
    def change(self) -> float | None:
        """Relative change from the first to the second; None for words and for a first value of zero."""
        numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (self.a, self.b))
        if not numbers or not self.a:
            return None
        assert isinstance(self.a, (int, float)) and isinstance(self.b, (int, float))
        found = (self.b - self.a) / abs(self.a)
        return found if math.isfinite(found) else None


def run_difference(a: Path, b: Path) -> list[DifferenceRow]:
    """Figures of two runs.

    Parameters
    ----------
    a, b : Path
        Run directories, or their summary.json.

    Returns
    -------
    list of DifferenceRow
        Verdict, errors, sizes and times; number of natural frequencies of each body and of the system in each
        configuration, with the lowest and the highest.

    Raises
    ------
    ReadError
        If one holds no summary of a run.
    """
    one, other = _figures(a), _figures(b)
    rows = [DifferenceRow(what, one.get(what), other.get(what)) for what in dict.fromkeys([*one, *other])]
    return [row for row in rows if not (row.a is None and row.b is None)]


def _figures(path: Path) -> dict[str, Any]:
    expect_kind(path, "result")
    file = path / "summary.json" if path.is_dir() else path
    if file.is_file() and file_kind(file).name == "component":
        raise ReadError(
            f"{path}: this is a component file, not a run; name the folders of two runs, or compare two component "
            "files by `cmsreduce check FILE --baseline OTHER`"
        )
    if not file.is_file():
        raise ReadError(f"{path}: there is no summary.json; give the output directory of a finished run")
    facts = read_summary(file)
    try:
        # A run without limits passes no more than one that breaks them.
        found: dict[str, Any] = {"passed": facts["passed"], "verdict": (facts.get("verdict") or {}).get("word")}
        found |= {f"worst {name}": value for name, value in (facts["worst"] or {}).items()}
        found |= {f"worst {name}": figure["value"] for name, figure in facts.get("figures", {}).items()}
        for name, part in facts["components"].items():
            found |= {f"{name}: {key}": part[key] for key in _COMPONENT}
            found |= _frequencies(name, part["frequencies_hz"])
        for system in facts["system"]:
            found |= _frequencies(f"system {system['name']}", system["frequencies_hz"])
        for row in facts["configurations"]:
            found |= {f"{row['name']}: {key}": row[key] for key in ("frf_error", "n_reduced")}
        return found | {key: (facts["speed"] or {}).get(key) for key in _SPEED}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ReadError(f"{file}: this is no summary of a run; run the pipeline again") from None


def _frequencies(name: str, hz: list[float]) -> dict[str, Any]:
    """Number of frequencies, the lowest and the highest."""
    finite = [value for value in hz if value is not None]
    ends = {"lowest": min(finite, default=None), "highest": max(finite, default=None)}
    return {f"{name}: modes": len(hz), **{f"{name}: {end} Hz": value for end, value in ends.items()}}
