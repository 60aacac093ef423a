"""Reference page of the pipeline file: every key of its JSON Schema with type, default, meaning and an example."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["key_page", "schema_keys"]

Schema = Mapping[str, Any]

_HEAD = """\
# Keys of the pipeline file

Made from the JSON Schema that `cmsreduce schema` prints. `NAME` stands for your own name, `[]` for an item of a list. A
key with several forms lists them. A key that its mapping must have is marked needed.
"""


def key_page(schema: Schema) -> str:
    """Markdown of the page, a section for each key of the outermost mapping.

    Parameters
    ----------
    schema : mapping
        JSON Schema of the pipeline file.
    """
    lines = [_HEAD]
    section = ""
    for path, key, needed in schema_keys(schema):
        if path.partition(".")[0] != section:
            section = path.partition(".")[0]
            lines.append(f"\n## {section}\n")
        if path != section:
            lines.append(f"\n### `{path}`\n")
        facts = [_in_words(key, schema)]
        if "default" in key and key["default"] is not None:
            facts.append(f"default `{_plain(key['default'])}`")
        elif needed:
            facts.append("needed")
        lines.append(f"{key['description']}\n\n{', '.join(facts)}.\n")
        name = path.rpartition(".")[2]
        lines += [f"```yaml\n{name}: {_plain(example)}\n```\n" for example in key.get("examples", [])]
    return "\n".join(lines)


def schema_keys(schema: Schema) -> Iterator[tuple[str, Schema, bool]]:
    """Path, description and need of every key, in the order of the schema; a mapping that holds itself is listed once.

    Parameters
    ----------
    schema : mapping
        JSON Schema.
    """
    yield from _keys(schema, schema, "", ())


def _keys(at: Schema, schema: Schema, path: str, above: tuple[str, ...]) -> Iterator[tuple[str, Schema, bool]]:
    needed = at.get("required", [])
    for name, key in at.get("properties", {}).items():
        here = f"{path}.{name}" if path else name
        yield here, key, name in needed
        listed = set(above)
        for inner, suffix, ref in _mappings(key, schema):
            if ref not in listed:
                listed.add(ref)
                yield from _keys(inner, schema, here + suffix, (*above, ref))


def _mappings(key: Schema, schema: Schema, name: str = "") -> Iterator[tuple[Schema, str, str]]:
    """Mappings with keys of their own below a key: the schema, the addition to the path, the name."""
    if "$ref" in key:
        named = key["$ref"].rpartition("/")[2]
        yield from _mappings(schema["$defs"][named], schema, named)
    if "properties" in key:
        yield key, "", name
    for arm in (*key.get("anyOf", ()), *key.get("oneOf", ()), *key.get("allOf", ())):
        yield from _mappings(arm, schema, name)
    for keyword, added in (("additionalProperties", ".NAME"), ("items", "[]")):
        if isinstance(key.get(keyword), dict):
            for inner, suffix, inner_name in _mappings(key[keyword], schema):
                yield inner, added + suffix, inner_name


def _in_words(key: Schema, schema: Schema) -> str:
    words = list(dict.fromkeys(_kinds(key, schema)))
    return " or ".join(word for word in words if word != "null") or "anything"


def _kinds(key: Schema, schema: Schema) -> Iterator[str]:
    arms = (*key.get("anyOf", ()), *key.get("oneOf", ()), *key.get("allOf", ()))
    if "$ref" in key:
        yield from _kinds(schema["$defs"][key["$ref"].rpartition("/")[2]], schema)
    elif arms:
        for arm in arms:
            yield from _kinds(arm, schema)
    elif "enum" in key:
        yield from (f"`{_plain(value)}`" for value in key["enum"])
    elif "const" in key:
        yield f"`{_plain(key['const'])}`"
    elif key.get("type") == "array":
        of = _in_words(key["items"], schema) if isinstance(key.get("items"), dict) else ""
        yield f"list of ({of})" if of and of != "anything" else "list"
    elif key.get("type") == "object":
        yield "mapping"
    else:
        kinds = key.get("type", [])
        yield from (_TYPES.get(kind, kind) for kind in ([kinds] if isinstance(kinds, str) else kinds))


_TYPES = {"string": "text", "integer": "whole number", "number": "number", "boolean": "true or false"}


def _plain(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
