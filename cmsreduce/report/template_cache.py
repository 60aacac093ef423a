"""Compiled templates, kept where Python keeps its compiled modules."""

from __future__ import annotations

import contextlib
import marshal
import os
import secrets
import sys
from importlib.util import MAGIC_NUMBER
from pathlib import Path

from jinja2 import BytecodeCache
from jinja2.bccache import Bucket

__all__ = ["TemplateCache"]


class TemplateCache(BytecodeCache):
    """Templates in ``__pycache__`` beside this module, with Python's own rules.

    Nothing is written where the folder cannot be, or where Python was told to write no bytecode; a template that has
    changed, or was compiled by another version, is compiled again. Compiling takes a quarter of a short run.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Fill a bucket from its file, if there is one of this version and this source."""
        with contextlib.suppress(OSError, EOFError, ValueError, TypeError):
            data, head = _place(bucket).read_bytes(), _head(bucket)
            if data.startswith(head):
                bucket.code = marshal.loads(data[len(head) :])

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write a bucket under another name, then rename it: a reader sees the whole or nothing."""
        if sys.dont_write_bytecode:
            return
        place = _place(bucket)
        part = place.with_name(f"{place.name}.{os.getpid()}-{secrets.token_hex(4)}")
        with contextlib.suppress(OSError):
            try:
                part.write_bytes(_head(bucket) + marshal.dumps(bucket.code))
                part.replace(place)
            finally:
                part.unlink(missing_ok=True)


def _place(bucket: Bucket) -> Path:
    return Path(__file__).parent / "__pycache__" / f"{bucket.key}.template"


def _head(bucket: Bucket) -> bytes:
    """What a file begins with: Python's version and the template it was compiled from."""
    return MAGIC_NUMBER + bucket.checksum.encode()
