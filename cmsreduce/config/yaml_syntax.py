"""Faults of YAML syntax in the words of a user, with file, line and column."""

from __future__ import annotations

import re
from typing import NoReturn

from ruamel.yaml.error import MarkedYAMLError

from cmsreduce.errors import ConfigError

__all__ = ["refuse_syntax"]

# Words of the library, and what they mean for the user; {} is the line where the mapping or the bracket starts.
_SYNTAX = (
    ("\\t", "a tab stands here; YAML is indented with spaces, not with tabs"),
    ("but found '<block", "the indentation fits no key above: keys of one mapping start in the same column"),
    (
        "could not find expected ':'",
        "line {} has no ': ' after its key: write KEY: VALUE, with a blank after the colon",
    ),
    (
        "mapping values are not allowed",
        "a ':' where no key can be: a text that holds ': ' needs quotes, and keys of one mapping the same indentation",
    ),
    ("expected ',' or '", "the bracket that opens in line {} is not closed, or a comma is missing before this place"),
    ("found unexpected end of stream", "the quote that opens here is not closed"),
    (
        "that cannot start any token",
        "no value starts with this sign: put a text in quotes, write 5 % for per cent",
    ),
    ("another document", "a second document starts here; a pipeline is one document, without '---' inside"),
)
# A key with its value, and no blank between them: YAML takes both for one text, and the next line for wrong.
_NO_BLANK = re.compile(r"\s*([\w-]+):[^\s:/\\]")


def refuse_syntax(error: MarkedYAMLError, text: str, source: str, in_override: bool) -> NoReturn:
    """Say what is wrong, and where.

    Parameters
    ----------
    error : MarkedYAMLError
        Error of the parser.
    text : str
        The document.
    source : str
        Name of its file, or the override whose value it is.
    in_override : bool
        True for the value of an override, which has no lines.

    Raises
    ------
    ConfigError
        Always.
    """
    mark, start = error.problem_mark or error.context_mark, error.context_mark
    if mark is not None and not in_override:
        lines = text.split("\n")
        for number in (mark.line, mark.line - 1):
            if 0 <= number < len(lines) and (found := _NO_BLANK.match(lines[number])) is not None:
                where, key = f"{source}:{number + 1}:{found.end(1) + 1}", found[1]
                raise ConfigError(f"{where}: YAML syntax: no blank after the colon of '{key}': write {key}: VALUE")
    if re.search("could not find expected ':'|unexpected end of stream", error.problem or ""):
        mark = start
    where = source if mark is None or in_override else f"{source}:{mark.line + 1}:{mark.column + 1}"
    problem = ", ".join(part for part in (error.context, error.problem) if part) or "the text cannot be read"
    line = "?" if start is None else start.line + 1
    # The problem itself quotes the text, whose braces are no places to fill.
    words = next((known.format(line) for found, known in _SYNTAX if found in problem), problem)
    if "but found '<block" in problem and mark is not None and not in_override:
        above = next((n for n in range(mark.line - 1, -1, -1) if text.split("\n")[n].strip()), None)
        words += "" if above is None else f" (compare with line {above + 1})"
    raise ConfigError(f"{where}: YAML syntax: {words}") from None
