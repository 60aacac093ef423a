"""Seal of an HDF5 file: a checksum of its whole content, which shows a change by any program.

The checksums of HDF5 find damaged bytes, but a program that changes a value writes them again. The recipe of the seal
is on docs/component-file.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.errors import ReadError, refuse_unreadable
from cmsreduce.model import hdf5_items
from cmsreduce.write.files import put_texts

__all__ = [
    "SEAL",
    "SEALED_ITEMS",
    "broken_seal",
    "changed_items",
    "content_digests",
    "is_sealed",
    "put_seal",
    "verify_seal",
]

SEAL = "content_sha256"
"""Attribute of the root: SHA-256 of all lines ``item digest``."""

SEALED_ITEMS = "seal"
"""Group of the digests of single items, which name the item that was changed."""

# Time of writing, and the seal itself.
_UNSEALED = {"@created_utc", f"@{SEAL}"}
_NAMED = 3


def content_digests(datasets: Mapping[str, Any], attributes: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """SHA-256 of every dataset and attribute.

    Parameters
    ----------
    datasets : mapping of path to array
        Values as read from the file.
    attributes : mapping of path to mapping
        Attributes of groups and datasets; the path of the root is ``""``.

    Returns
    -------
    dict of item to str
        Hexadecimal; a dataset is named by its path, an attribute ``PATH@NAME``. The seal and the time of writing are
        left out.
    """
    items = {path: value for path, value in datasets.items() if not path.startswith(f"{SEALED_ITEMS}/")}
    for path, values in attributes.items():
        if path != SEALED_ITEMS and not path.startswith(f"{SEALED_ITEMS}/"):
            items |= {f"{path}@{name}": value for name, value in values.items()}
    return {item: _digest(value) for item, value in items.items() if item not in _UNSEALED}


def put_seal(file: Any) -> None:
    """Seal a file that is otherwise complete.

    Parameters
    ----------
    file : h5py.File
        Open for writing.
    """
    digests = _digests_of({"": file, **_items(file)})
    group = file.create_group(SEALED_ITEMS)
    put_texts(group, "item", sorted(digests), "every dataset, and every attribute as PATH@NAME")
    put_texts(group, "sha256", [digests[item] for item in sorted(digests)], "of type, shape and bytes of each")
    file.attrs[SEAL] = _total(digests)


def verify_seal(path: Path) -> bool:
    """Compare the content of a file with its seal; False if it has none.

    Raises
    ------
    ReadError
        If the file cannot be read or is damaged, or its content was changed; the message names what differs.
    """
    import h5py

    refuse_unreadable(path)
    try:
        with h5py.File(path, "r") as file:
            items = hdf5_items(file, path.stat().st_size)
            if SEAL not in file.attrs:
                return False
            stored = {item: items[f"{SEALED_ITEMS}/{item}"][()] for item in ("item", "sha256")}
            fault = broken_seal(_digests_of(items), file.attrs[SEAL], stored["item"], stored["sha256"])
    except ReadError as error:
        raise ReadError(f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise ReadError(f"{path}: the file is damaged or incomplete ({error}); write it again") from None
    if fault:
        raise ReadError(f"{path}: {fault}; write the file again with `cmsreduce run`")
    return True


def is_sealed(path: Path) -> bool:
    """True if a file has a seal; it is not compared with the content."""
    import h5py

    with h5py.File(path, "r") as file:
        return SEAL in file.attrs


def broken_seal(digests: Mapping[str, str], seal: object, items: Any, sealed: Any) -> str | None:
    """Difference between a content and its seal, in words; None if there is none.

    Parameters
    ----------
    digests : mapping of item to str
        As of `content_digests`.
    seal : object
        Attribute of the root.
    items, sealed : (k,) bytes
        Datasets of the group `SEALED_ITEMS`.
    """
    if seal == _total(digests):
        return None
    pairs = zip(np.ravel(items).tolist(), np.ravel(sealed).tolist(), strict=False)
    before = {_text(item): _text(digest) for item, digest in pairs}
    changed = changed_items(digests, before)
    return f"its content is not what was written ({changed or 'the seal itself was changed'})"


def changed_items(digests: Mapping[str, str], before: Mapping[str, str]) -> str:
    """Items that differ between two sets of digests, in words; empty if there is none."""
    changes = {
        "changed": [item for item in digests if item in before and before[item] != digests[item]],
        "added": [item for item in digests if item not in before],
        "removed": [item for item in before if item not in digests],
    }
    return "; ".join(
        f"{how}: {', '.join(sorted(found)[:_NAMED])}{f' and {len(found) - _NAMED} more' * (len(found) > _NAMED)}"
        for how, found in changes.items()
        if found
    )


def _digests_of(items: Mapping[str, Any]) -> dict[str, str]:
    import h5py

    datasets = {path: item[()] for path, item in items.items() if isinstance(item, h5py.Dataset)}
    return content_digests(datasets, {path: dict(item.attrs) for path, item in items.items()})


def _items(file: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    file.visititems(found.__setitem__)
    return found


def _digest(value: Any) -> str:
    array = np.asarray(value)
    # Text of variable length has no bytes of its own.
    text = array.dtype.kind in "UO"
    data = "\n".join(map(str, array.ravel().tolist())).encode() if text else array.tobytes()
    kind = "text" if text else array.dtype.str
    return hashlib.sha256(f"{kind} {array.shape} ".encode() + data).hexdigest()


def _total(digests: Mapping[str, str]) -> str:
    lines = "".join(f"{item} {digests[item]}\n" for item in sorted(digests))
    return hashlib.sha256(lines.encode()).hexdigest()


def _text(value: Any) -> str:
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
