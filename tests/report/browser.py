"""A browser without a screen: opens a page from the disk, and tells what it complained about."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

__all__ = ["Opened", "launched", "needs_browser", "opened"]


def _absent() -> bool:
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return True
    return shutil.which("chromium") is None


needs_browser = pytest.mark.skipif(_absent(), reason="chromium is not on the PATH, or playwright is not installed")


@dataclass
class Opened:
    """An open page.

    Parameters
    ----------
    page : playwright.sync_api.Page
    faults : list of str
        Errors and warnings of the console, scripts that failed, and anything the page asked the network for.
    """

    page: Any
    faults: list[str] = field(default_factory=list)

    def draw_all(self) -> None:
        """Open and draw all, as for a printer."""
        self.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        self.page.evaluate("document.documentElement.dataset.still = 1; dispatchEvent(new Event('beforeprint'))")

    def choose(self, select: str, value: str) -> None:
        """Choose an option as a user does."""
        self.page.select_option(f"#{select}", value)

    def watch(self) -> None:
        """Listen to all that goes wrong."""
        self.page.on(
            "console", lambda said: self.faults.append(said.text) if said.type in ("error", "warning") else None
        )
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on(
            "request",
            lambda asked: (
                self.faults.append(asked.url) if not asked.url.startswith(("file:", "data:", "blob:")) else None
            ),
        )


@contextmanager
def launched() -> Iterator[Any]:
    """Start the browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(browser: Any, path: Path, width: int = 1300, **context: Any) -> Iterator[Opened]:
    """Open a file in a window of 900 pixels height; the network is cut off."""
    size = {"width": width, "height": 900}
    context = browser.new_context(viewport=size, offline=True, accept_downloads=True, **context)
    found = Opened(context.new_page())
    found.watch()
    found.page.goto(path.as_uri())
    try:
        yield found
    finally:
        context.close()
