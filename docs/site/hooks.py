"""Pages of the site: the pages of the repository under their own names, and the reference.

A page keeps its place in the repository, so that one link works in both.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any

from api_pages import ROOMS, api_page
from key_page import key_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from notebook_page import PLOTLY, notebook_page, plotly_script

from cmsreduce.config import json_schema

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/*.md", "sample_models/*/README.md", "benchmarks/*.md")
NOTEBOOKS = "examples/notebooks/*.ipynb"
# The first page of the site, and the place that leaves for the page of that name.
START = {"docs/index.md": "index.html", "README.md": "README.html"}
_LINK = re.compile(r"\]\(([^)#:\s]+)[^)\s]*\)")


def repository_files() -> list[PurePosixPath]:
    """Pages, relative to the root of the repository, and the files that they link to."""
    pages = [path for pattern in PAGES for path in sorted(ROOT.glob(pattern))]
    linked = {
        target
        for page in pages
        for link in _LINK.findall(page.read_text(encoding="utf-8"))
        if (target := (page.parent / link).resolve()).is_file() and target.is_relative_to(ROOT)
    }
    return [PurePosixPath(path.relative_to(ROOT).as_posix()) for path in [*pages, *sorted(linked - set(pages))]]


def reference_pages() -> dict[str, str]:
    """Text of each generated page by its path: the keys of the pipeline file, and the names of each room."""
    pages = {"reference/pipeline-file.md": key_page(json_schema())}
    pages |= {f"reference/{room}.md": api_page(room) for room in ROOMS}
    # What a search finds in the guide stands before what it finds here.
    return {path: f"---\nsearch: {{boost: 0.2}}\n---\n\n{text}" for path, text in pages.items()}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the generated pages in the navigation."""
    entries: list[Any] = [{"Keys of the pipeline file": "reference/pipeline-file.md"}]
    entries += [{f"cmsreduce.{room}": f"reference/{room}.md"} for room in ROOMS]
    for item in config.nav or []:
        if "Reference" in item:
            item["Reference"] = entries
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Replace the files in the folder of the site by the pages of the repository."""
    for file in list(files):
        if file.src_dir == config.docs_dir:
            files.remove(file)
    for path in repository_files():
        file = File(str(path), str(ROOT), config.site_dir, config.use_directory_urls)
        file.dest_uri = START.get(str(path), file.dest_uri)
        files.append(file)
    generated = reference_pages()
    for notebook in sorted(ROOT.glob(NOTEBOOKS)):
        path = notebook.relative_to(ROOT).with_suffix(".md")
        generated[path.as_posix()] = notebook_page(notebook, "../" * (len(path.parts) - 1))
    generated[PLOTLY] = plotly_script()
    for name, source in {"iframe-worker.js": "search_worker.js", "site.css": "site.css"}.items():
        generated[f"assets/{name}"] = (ROOT / "docs/site" / source).read_text(encoding="utf-8")
    for path, text in generated.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead to the page of a notebook, not to its file; the page itself offers the file."""
    return markdown if page.file.src_uri.startswith("examples/") else markdown.replace(".ipynb)", ".md)")
