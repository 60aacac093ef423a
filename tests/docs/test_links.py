"""Links lead somewhere, on the pages of the repository; `make docs` checks those of the site."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT

LINKED = [
    *PAGES,
    *(f"benchmarks/{page.name}" for page in sorted(ROOT.glob("benchmarks/*.md"))),
    *(f"sample_models/{p.parent.name}/README.md" for p in ROOT.glob("sample_models/*/README.md")),
]


def anchors(page: Path) -> set[str]:
    """Names that a repository's page gives its headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", LINKED)
def test_links_lead_somewhere(page: str) -> None:
    here = ROOT / page
    for link in re.findall(r"\]\(([^)\s]+)\)", here.read_text()):
        if "://" in link:
            continue
        target, _, anchor = link.partition("#")
        there = (here.parent / target).resolve() if target else here
        assert there.exists(), link
        if anchor:
            assert anchor in anchors(there), link


@pytest.mark.parametrize("page", LINKED)
def test_tests_that_a_page_names_exist(page: str) -> None:
    """A name without a folder follows one in the same cell of a table, whose folder it shares."""
    for line in (ROOT / page).read_text().split("\n"):
        folder = ROOT
        for name in re.findall(r"`((?:[\w/]+/)?test_\w+\.py)`", line):
            tried = (ROOT / name, ROOT / "tests" / name) if "/" in name else (folder / name,)
            found = next((path for path in tried if path.is_file()), None)
            assert found is not None, f"{name}: {line}"
            folder = found.parent


def test_the_readme_leads_to_every_page() -> None:
    pages = {"README.md"}
    found = {"README.md"}
    while found:
        found = {
            target.relative_to(ROOT).as_posix()
            for page in found
            for link in re.findall(r"\]\(([^)#\s]+\.md)[^)]*\)", (ROOT / page).read_text())
            if "://" not in link and (target := ((ROOT / page).parent / link).resolve()).is_file()
        } - pages
        pages |= found
    assert set(PAGES) <= pages
