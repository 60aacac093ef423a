"""What a page that opens offline is made of: its scripts, its data, and the plotting library."""

from __future__ import annotations

import json
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from typing import Any

from cmsreduce.report.packing import compressed

__all__ = ["embedded", "packed_plotly", "part", "start_packing"]

# Compression that takes half the time of the strongest, for a library 4 % larger.
_QUICK = 4


def packed_plotly() -> str:
    """The plotting library, compressed: the page unpacks it when it opens."""
    return start_packing().result()


@cache
def start_packing() -> Future[str]:
    """Compress the plotting library beside other work: it takes longer than the rest of a page."""

    def work() -> str:
        return compressed(files("plotly").joinpath("package_data", "plotly.min.js").read_bytes(), _QUICK)

    return ThreadPoolExecutor(1).submit(work)


def embedded(data: Any) -> str:
    """JSON that cannot end the script element it stands in, whatever the names in it."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def part(name: str) -> str:
    """Text of a script, a style or a template that comes with the package."""
    return files("cmsreduce.report").joinpath(name).read_text(encoding="utf-8")
