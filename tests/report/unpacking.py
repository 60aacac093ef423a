"""Arrays of a page, unpacked as its scripts unpack them."""

from __future__ import annotations

import base64
import gzip

import numpy as np

GAP, MIDDLE = -32768, 32767


def unpacked(block: str, where: dict) -> np.ndarray:
    """One array out of the compressed block."""
    data = gzip.decompress(base64.b64decode(block))
    array = np.frombuffer(data, dtype=f"<{where['as']}", count=where["n"], offset=where["at"]).astype(np.float64)
    if where.get("sum"):
        return np.cumsum(array)
    if "step" in where:
        return np.where(array == GAP, np.nan, where["low"] + (array + MIDDLE) * where["step"])
    return array
