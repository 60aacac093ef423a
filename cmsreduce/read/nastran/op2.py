"""Matrices of NASTRAN OUTPUT2 files: pyYeti finds them, and they are read column by column without a dense array."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP
from cmsreduce.read.files import FileBytes, reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, LabelledMatrix, canonical, check_size, mirrored
from cmsreduce.read.nastran.dmig_entries import DMIG_FORMS, assembled_dmig
from cmsreduce.read.nastran.op4 import FORMS, SYMMETRIC, first_record
from cmsreduce.read.nastran.op4_header import TYPES

if TYPE_CHECKING:
    import pyyeti.nastran.op2

__all__ = ["OP2", "check_records", "directory"]

_TABLE, _MATRIX = 0, 1  # types of a data block
_DIRECTORY = "XSOP2DIR"
_DMIG_HEAD = (114, 1, 120)  # first words of a table of DMIG entries
_FIRST_COLUMN = 12  # words of such a table before its first column
_SMALLEST = 12  # bytes of the first record


@dataclass(frozen=True)
class _Block:
    """A matrix data block; ``start`` is the byte of its first column."""

    name: str
    rows: int
    cols: int
    form: int
    type: int
    start: int


def _op2_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of an OP2 file of 32 or 64-bit words in either byte order, and tables of DMIG entries.

    Raises
    ------
    ReadError
        If the file is truncated or damaged; all of its records are checked first.
    """
    from pyyeti.nastran import op2

    check_records(path)
    with reading(path, "the table of contents of the OP2 file"), op2.OP2(str(path)) as file:
        blocks, tables = [], []
        true_names = directory(file)
        for place, found in enumerate(file.dblist):
            if found.dbtype == _MATRIX:
                file.set_position(found.start)
                name, (_, cols, rows, form, kind, *_), _ = file.rdop2nt()
                blocks.append(_Block(true_names.get(place, name), rows, cols, form, kind, file.file_handle().tell()))
            elif found.dbtype == _TABLE and _is_dmig(path, found.start, file):
                tables.append(_dmig(path, found.start, true_names.get(place)))
    size = path.stat().st_size
    for block in blocks:
        check_size(path, block.name, block.rows, block.cols, size)
        if block.type not in TYPES:
            raise ReadError(f"{path}: OP2 matrix '{block.name}' has type {block.type}, which is none of 1, 2, 3, 4")
    return [
        StoredMatrix(
            block.name,
            TYPES[block.type],
            FORMS.get(block.form, f"form {block.form}"),
            (block.rows, block.cols, None),
            partial(_load, path, block),
        )
        for block in blocks
    ] + tables


def directory(file: pyyeti.nastran.op2.OP2) -> dict[int, str]:
    """True names of the data blocks of an OP2 file of a superelement, by place; empty for other files.

    ``EXTSEOUT(DMIGOP2=unit)`` of NX writes a table of names before all blocks, which are all called EXTDB.
    """
    if not file.dblist or str(file.dblist[0].name).strip() != _DIRECTORY:
        return {}
    file.set_position(file.dblist[0].start)
    file.rdop2nt()
    names = [_DIRECTORY]
    while (record := file.rdop2record()) is not None:
        words = np.asarray(record)
        # Names of 64-bit files are spread over words of eight bytes.
        text = words.tobytes().decode("latin-1")
        names.append("".join(text[k : k + 4] for k in range(0, len(text), words.itemsize)).strip())
    return dict(enumerate(names)) if len(names) == len(file.dblist) else {}


def _is_dmig(path: Path, start: int, file: pyyeti.nastran.op2.OP2) -> bool:
    """Return whether a table holds DMIG entries, from its first words; other tables may be large."""
    file.set_position(start)
    file.rdop2nt()
    at = file.file_handle().tell()
    with path.open("rb") as handle:
        order = "<" if struct.unpack("<i", handle.read(4))[0] in (4, 8) else ">"
        handle.seek(at)
        word = struct.unpack(order + "i", handle.read(4))[0]
        # A key of one word comes before the record.
        handle.seek(at + 8 + word + 4)
        head = handle.read(3 * word)
    return len(head) == 3 * word and struct.unpack(f"{order}3{'i' if word == 4 else 'q'}", head) == _DMIG_HEAD


def _dmig(path: Path, start: int, true_name: str | None) -> StoredMatrix:
    """The matrix of a table of DMIG entries, which has the labels of its dofs, and may have its name elsewhere."""
    from pyyeti.nastran import op2

    with op2.OP2(str(path)) as file:
        file.set_position(start)
        file.rdop2nt()
        record = np.asarray(file.rdop2record())
    name = record[3:5].tobytes().decode("latin-1").replace("\0", "").strip()
    if record.itemsize == 8:
        name = "".join(part[:4] for part in (name[:8], name[8:])).strip()
    name, form, kind = true_name or name, int(record[6]), int(record[7])
    if form not in DMIG_FORMS or kind not in TYPES:
        raise ReadError(f"{path}: the OP2 table of DMIG '{name}' has form {form} and type {kind}; the file is damaged")

    def load() -> LabelledMatrix:
        rows, cols, values = _dmig_entries(record, kind)
        rounding = SINGLE if kind == 1 and record.itemsize == 4 else DOUBLE
        return assembled_dmig(path, name, form, rows, cols, values, rounding)

    def size() -> tuple[int, int, int | None]:
        return (*load().A.shape, None)

    return StoredMatrix(name, TYPES[kind], DMIG_FORMS[form], size, load)


def _dmig_entries(
    record: NDArray[np.signedinteger], kind: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Dof keys of rows and columns, and real parts: each column is its dof, then entries up to a pair of -1."""
    number = np.dtype(f"f{4 if kind in (1, 3) and record.itemsize == 4 else 8}")
    step = 2 + number.itemsize // record.itemsize * (1 if kind <= 2 else 2)
    rows, cols, values = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0)]
    at = _FIRST_COLUMN
    while at < record.size - 2:
        column = int(record[at]) * KEY_STEP + int(record[at + 1])
        ends = np.flatnonzero(record[at + 2 :: step] == -1)
        if not ends.size:
            raise ValueError(f"column {record[at]}.{record[at + 1]} of a DMIG has no end")
        count = int(ends[0])
        entries = record[at + 2 : at + 2 + count * step].reshape(count, step)
        rows.append(entries[:, 0].astype(np.int64) * KEY_STEP + entries[:, 1])
        cols.append(np.full(count, column))
        values.append(np.ascontiguousarray(entries[:, 2:]).view(number)[:, 0].astype(np.float64))
        at += 2 + count * step + 2
    return np.concatenate(rows), np.concatenate(cols), np.concatenate(values)


def _order(content: FileBytes) -> str:
    """Byte order, from the length of the first record, which is one word."""
    return "<" if content.unpack(struct.Struct("<i"), 0)[0] in (4, 8) else ">"


def check_records(path: Path) -> None:
    """Check that every record has the same length before and after it."""
    if path.stat().st_size < _SMALLEST:
        raise ReadError(f"{path}: the OP2 file is truncated: it has no more than {path.stat().st_size} bytes")
    content = FileBytes(path)
    marker = struct.Struct(_order(content) + "i")
    size, at = len(content), 0
    while at < size:
        length = content.unpack(marker, at)[0] if at + 4 <= size else 0
        end = at + 8 + length
        if length < 0 or end > size:
            raise ReadError(
                f"{path}: the OP2 file is truncated: the record at byte {at} needs {end} bytes up to its end and "
                f"the file has {size}; write it again, or copy it again in binary mode"
            )
        if content.unpack(marker, end - 4)[0] != length:
            raise ReadError(
                f"{path}: the OP2 file is damaged: the record at byte {at} opens with the length {length} and "
                f"closes with {content.unpack(marker, end - 4)[0]}; copy it again in binary mode"
            )
        at = end


def _load(path: Path, block: _Block) -> LabelledMatrix:
    """Read one matrix."""
    with reading(path, f"OP2 matrix '{block.name}'"):
        content = FileBytes(path)
        order = _order(content)
        word = content.unpack(struct.Struct(order + "i"), 0)[0]
        single = block.type == 1
        number = np.dtype(f"{order}f{word if single else 8}")
        rows, cols, values = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0)]
        for row, col, string in _strings(content, block, order, word, number):
            kept = np.flatnonzero(string)
            rows.append(kept + row)
            cols.append(np.full(kept.size, col))
            values.append(string[kept])
        shape = (block.rows, block.cols)
        A = canonical(np.concatenate(rows), np.concatenate(cols), np.concatenate(values), shape)
    if block.form == SYMMETRIC:
        A = mirrored(A)
    return LabelledMatrix(A, block.name, path, "op2", SINGLE if single and word == 4 else DOUBLE)


def _strings(
    content: FileBytes, block: _Block, order: str, word: int, number: np.dtype[np.floating]
) -> Iterator[tuple[int, int, NDArray[np.float64]]]:
    """Row, column (both from zero) and numbers of every string.

    A column is a chain of records: a key that counts words of numbers, then row and numbers, until a key of zero or
    less. One more key follows, and then the key that is positive if there is another column.
    """
    integer, marker = struct.Struct(order + ("i" if word == 4 else "q")), struct.Struct(order + "i")
    at = block.start

    def record() -> tuple[int, int]:
        nonlocal at
        length = content.unpack(marker, at)[0]
        start, at = at + 4, at + 8 + length
        return start, length

    def key() -> int:
        start, length = record()
        if length != word:
            raise ValueError(f"a key of {length} bytes at byte {start - 4}")
        return int(content.unpack(integer, start)[0])

    col, more = 0, 1
    while more > 0:
        while (words := key()) > 0:
            start, length = record()
            row = content.unpack(integer, start)[0] - 1
            count = (length - word) // number.itemsize
            if length != (words + 1) * word or row < 0 or row + count > block.rows or col >= block.cols:
                raise ValueError(f"a string of {count} numbers at row {row + 1}, column {col + 1}")
            yield row, col, np.frombuffer(content[start + word : start + length], number, count).astype(np.float64)
        col += 1
        key()
        more = key()


OP2 = MatrixFormat("op2", "NASTRAN OUTPUT2", lambda path, head: bool(first_record(head) & {4, 8}), _op2_matrices)
