"""Read a pipeline file: includes, overrides, validation, and one message with all errors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cmsreduce.config.copies import copies_written_out, without_repetitions
from cmsreduce.config.grammar import is_mapping_of_values, models_at
from cmsreduce.config.keys import Pipeline
from cmsreduce.config.located import Entry, Location, merge, parse, plain
from cmsreduce.config.problems import config_error, located, problems_of, refuse_empty
from cmsreduce.config.references import broken_references
from cmsreduce.errors import ConfigError, ReadError, closest, refuse_device
from cmsreduce.model import DOF_NAMES

__all__ = ["load_pipeline", "pipeline_from_keys"]


def load_pipeline(path: Path, overrides: Sequence[str] = ()) -> Pipeline:
    """Read and check a pipeline file; the data files it names are not opened.

    Parameters
    ----------
    path : Path
        YAML 1.2 file. Names of data files in it, and in files it includes, are relative to the file they are
        written in; ``output`` is relative to the working directory.
    overrides : sequence of str
        ``a.b=value`` each, the value as YAML. They win over the file, and later ones over earlier ones. A mapping
        replaces the one in the file, while an included file is merged key by key.

    Returns
    -------
    Pipeline
        Its ``include`` names every included file, directly or through another file.

    Raises
    ------
    ReadError
        If the file, or one that it includes, is missing or cannot be read.
    ConfigError
        One line for each error: file, line, key, what was found, what is expected.
    """
    included: list[Path] = []
    root = _read(Path(path), (), included, {})
    for text in overrides:
        root = merge(root, _override(root, text), _adapt)
    if included and isinstance(root.value, dict):
        files = [Entry(str(file), root.where) for file in included]
        root = Entry({**root.value, "include": Entry(files, root.where)}, root.where)
    return _checked(root)


def pipeline_from_keys(keys: Mapping[str, Any], source: str) -> Pipeline:
    """Check a pipeline that is given as a mapping instead of a file.

    Parameters
    ----------
    keys : mapping
        As a pipeline file has them; arrays stand for lists.
    source : str
        Name in messages, in the place of file and line.

    Raises
    ------
    ConfigError
        As `load_pipeline` does.
    """
    text = json.dumps(keys, default=lambda value: value.tolist() if hasattr(value, "tolist") else str(value))
    return _checked(parse(text, source, Path(), in_override=True))


def _checked(root: Entry) -> Pipeline:
    """Validate a tree of keys; all errors make one message."""
    refuse_empty(root)
    root = copies_written_out(root, _adapt)
    try:
        pipeline = Pipeline.model_validate(plain(root))
    except ValidationError as error:
        errors = error.errors(include_url=False)
        own = without_repetitions(((each["loc"], each["type"]) for each in errors), root)
        raise config_error(problems_of(root, list(compress(errors, own)))) from None
    broken = list(broken_references(pipeline))
    own = without_repetitions(((each.keys, each.message) for each in broken), root)
    if broken:
        raise config_error([located(root, each.keys, each.message) for each in compress(broken, own)])
    pipeline._tree = root
    return pipeline


def _read(path: Path, chain: tuple[Path, ...], included: list[Path], trees: dict[Path, Entry]) -> Entry:
    """Tree of a file with its includes merged in; ``chain`` are the files that lead to it.

    ``trees`` holds finished files: one that many others include is read once.
    """
    root = parse(_text_of(path), str(path), path.parent)
    if root.value is None:
        raise ConfigError(f"{path}: the file is empty; `cmsreduce new NAME` writes one to start from")
    if not isinstance(root.value, dict):
        raise ConfigError(f"{root.where}: a mapping of keys is expected, such as 'components:' and 'scene:'")
    keys = dict(root.value)
    if not chain and not set(keys) & set(Pipeline.model_fields):
        raise ConfigError(
            f"{root.where}: none of its keys ({', '.join(list(keys)[:5])}) is one of a pipeline: is it a file of "
            "another program? `cmsreduce new NAME` writes a pipeline to start from"
        )
    include = keys.pop("include", None)
    own = Entry(keys, root.where)
    if include is None or (include.value is None and not include.empty):
        return own
    base: Entry | None = None
    chain = (*chain, path)
    for entry in include.value if isinstance(include.value, list) else [include]:
        file = _included_file(entry, chain)
        if file not in included:
            included.append(file)
        at = file.resolve()
        if at not in trees:
            trees[at] = _read(file, chain, included, trees)
        tree = trees[at]
        base = tree if base is None else merge(base, tree, _adapt)
    return own if base is None else merge(base, own, _adapt)


def _included_file(entry: Entry, chain: tuple[Path, ...]) -> Path:
    if not isinstance(entry.value, str) or not entry.value:
        raise ConfigError(f"{entry.where}: key 'include' takes file names, e.g. [../configs/default.yaml]")
    file = entry.where.folder / Path(entry.value).expanduser()
    refuse_device(file)
    if not file.is_file():
        raise ReadError(f"{entry.where}: key 'include': there is no file {file}{_similar(file)}")
    if file.resolve() in [earlier.resolve() for earlier in chain]:
        circle = " -> ".join(str(item) for item in (*chain, file))
        raise ConfigError(f"{entry.where}: key 'include': files include each other in a circle: {circle}")
    return file


def _text_of(path: Path) -> str:
    refuse_device(path)
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise ReadError(f"{path}: there is no such file{_similar(path)}") from None
    except OSError as error:
        raise ReadError(f"{path}: the file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}:{line}: this is not UTF-8 text: save the file as UTF-8") from None


def _similar(path: Path) -> str:
    """Suggest a file of the same folder with a similar name; of a link, where it leads."""
    if path.is_symlink():
        return f"; the link names {path.readlink()}"
    if "\\" in path.name:
        return "; it is a path of Windows: write it with /"
    folder = path.parent
    beside = [file.name for file in folder.iterdir()] if folder.is_dir() else []
    meant = closest(path.name, beside)
    return f", did you mean {folder / meant}?" if meant else ""


def _override(root: Entry, text: str) -> Entry:
    """Tree of one key for ``a.b=value``."""
    path, sign, value = text.partition("=")
    parts = path.strip().split(".")
    if not sign or not all(parts):
        raise ConfigError(f"--set {text}: write KEY=VALUE, e.g. --set balance.keep.frf_error=0.01")
    where = Location(f"--set {text}", None, Path())
    if not value.strip():
        raise ConfigError(f"{where}: there is no value: write null to leave a key out")
    if parts[0] == "include":
        raise ConfigError(f"{where}: 'include' cannot be set here: write 'include' into the file")
    entry = Entry(parse(value, where.source, where.folder, in_override=True).value, where, whole=True)
    for key in reversed(_split(root, parts)):
        entry = Entry({key: entry}, where)
    return entry


def _split(root: Entry, parts: list[str]) -> list[str]:
    """Keys of an override; a key may contain dots, as in ``scene.sensors.los.rows.rotor.1300.x``."""
    keys: list[str] = []
    entry: Entry | None = root
    while parts:
        known = entry.value if entry is not None and isinstance(entry.value, (dict, list)) else {}
        count = next((n for n in range(len(parts), 1, -1) if ".".join(parts[:n]) in known), 1)
        if is_mapping_of_values(keys):
            count = len(parts)
        elif keys == ["scene", "articulation"] and len(parts) > 1 and parts[1] in DOF_NAMES:
            count = 2
        key, parts = ".".join(parts[:count]), parts[count:]
        keys.append(key)
        if isinstance(known, list):
            entry = known[int(key)] if key.isdecimal() and int(key) < len(known) else None
        else:
            entry = known.get(key)
    return keys


def _adapt(keys: tuple[str, ...], base: Entry, over: Entry) -> Entry:
    """Write out a short form before a merge, and clear it where ``over`` has another alternative."""
    path = [int(key) if key.isdecimal() else key for key in keys]
    for model in models_at(path):
        if model.short_key and not isinstance(base.value, (dict, list)) and base.value is not None:
            base = Entry({model.short_key: base}, base.where)
        if not isinstance(base.value, dict) or not isinstance(over.value, dict):
            continue
        chosen = {key for key in over.value if key in model.alternatives}
        if chosen and any(key in base.value for key in model.alternatives if key not in chosen):
            return Entry({}, base.where)
    return base
