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
