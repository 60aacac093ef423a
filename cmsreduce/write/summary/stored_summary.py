"""The file summary.json: written whole and sealed, read with its content compared with the seal.

JSON is easily edited, and a limit, a check or a body that is gone leaves no trace in the rest. The seal is a digest of
the value of each key, whatever the layout of the text; programs that read the file need not know it.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from cmsreduce.errors import ReadError
from cmsreduce.model import RunResult
from cmsreduce.write.files import atomic_path
from cmsreduce.write.seal import SEALED_ITEMS, changed_items
from cmsreduce.write.summary.summary import summary

__all__ = ["read_summary", "sealed_text", "write_summary"]

_FIRST_SEALED = (0, 2)


def write_summary(path: Path, run: RunResult) -> None:
    """Write summary.json; the file is complete or absent."""
    text = sealed_text(summary(run))
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def sealed_text(facts: dict[str, Any]) -> str:
    """JSON of a summary and its seal."""
    return _laid_out({**facts, SEALED_ITEMS: _digests(facts)}) + "\n"


def read_summary(path: Path) -> dict[str, Any]:
    """Read summary.json, without its seal.

    Raises
    ------
    ReadError
        If the file holds no JSON mapping, its content is not what was written (the message names the keys), or the
        version that it names writes a seal and there is none.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        seal = facts.pop(SEALED_ITEMS, None)
        if seal is None:
            changed = "removed: seal" if _version(facts) >= _FIRST_SEALED else ""
        else:
            changed = changed_items(_digests(facts), dict(seal))
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise ReadError(f"{path}: this is no summary of a run; run the pipeline again") from None
    if changed:
        raise ReadError(f"{path}: its content is not what was written ({changed}); run the pipeline again")
    return dict(facts)


def _laid_out(value: Any, margin: str = "", *, in_list: bool = False) -> str:
    """JSON with a line for each list of plain values, and for each mapping of these in a list.

    With a line for each number, margins are two thirds of the file of a scene with thousands of channels.
    """
    parts = list(value.values()) if isinstance(value, dict) else value
    if _plain(value) or not parts or (in_list and isinstance(value, dict) and all(map(_plain, parts))):
        return json.dumps(value, allow_nan=False)
    inner = margin + "  "
    if isinstance(value, dict):
        ends, rows = "{}", [f"{json.dumps(key)}: {_laid_out(each, inner)}" for key, each in value.items()]
    else:
        ends, rows = "[]", [_laid_out(each, inner, in_list=True) for each in parts]
    return f"{ends[0]}\n{inner}" + f",\n{inner}".join(rows) + f"\n{margin}{ends[1]}"


def _plain(value: Any) -> bool:
    """True if a value is a string, a number, null, or a list of such without mappings in it."""
    return all(map(_plain, value)) if isinstance(value, (list, tuple)) else not isinstance(value, dict)


def _version(facts: dict[str, Any]) -> tuple[int, ...]:
    """First two numbers of the version that wrote a summary."""
    found = re.match(r"(\d+)\.(\d+)", str(facts.get("version", "")))
    return tuple(map(int, found.groups())) if found else ()


def _digests(facts: dict[str, Any]) -> dict[str, str]:
    texts = {key: json.dumps(value, allow_nan=False) for key, value in facts.items()}
    trees = {key: json.loads(text, parse_int=_number, parse_float=_number) for key, text in texts.items()}
    plain = {key: json.dumps(tree, sort_keys=True) for key, tree in trees.items()}
    return {key: hashlib.sha256(text.encode()).hexdigest() for key, text in plain.items()}


def _number(text: str) -> float:
    """The number in the form that all programs share: others write 1.0 as 1 and -0.0 as 0, and sort keys."""
    return float(text) + 0.0
