"""The pages of the documentation, taken apart into snippets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["PAGES", "ROOT", "Snippet", "commands", "inline", "snippets"]

ROOT = Path(__file__).parents[2]
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))),
]
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$|(?<=\n\n)((?:^ {4}[^\n]*\n(?:\n(?= {4}))?)+)", re.M | re.S)


@dataclass(frozen=True)
class Snippet:
    """A block of a page; ``language`` is empty for a fence without one, ``indented`` for a block without a fence."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def snippets(page: str) -> Iterator[Snippet]:
    text = (ROOT / page).read_text()
    for found in _BLOCK.finditer(text):
        language, fenced, indented = found.groups()
        line = text.count("\n", 0, found.start()) + 1
        if indented is None:
            yield Snippet(page, line, language, fenced)
        else:
            yield Snippet(page, line, "indented", re.sub(r"^ {4}", "", indented, flags=re.M))


def commands(page: str) -> list[str]:
    """Lines of its blocks that a reader types, continued lines joined, comments left out."""
    found = []
    for snippet in snippets(page):
        if snippet.language in ("", "sh", "indented"):
            text = re.sub(r"\\\n\s*|\n\s{8,}(?=\[)", " ", snippet.text)
            lines = (re.sub(r"\s+#\s.*$", "", line).strip() for line in text.split("\n"))
            found += [line for line in lines if re.match(r"(cmsreduce|make|pip|python|cp|mkdir) ", line)]
    return found


def inline(page: str) -> list[str]:
    """Code within lines of text."""
    prose = re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(), flags=re.M | re.S)
    return [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose)]
