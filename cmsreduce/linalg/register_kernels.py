"""Code for products of a few columns with a few right-hand sides, which stay in registers while rows pass by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["COLUMNS", "NARROW", "WIDE", "subtract_narrow", "subtract_wide", "transposed_narrow", "transposed_wide"]

# With 32 registers of 64 bytes, eight columns of the block and what belongs to them stay in registers; with 16 of 32
# bytes four.
_MANY = bool(binding.get_host_cpu_features().get("avx512f", False))
_REGISTER = 64 if _MANY else 32
COLUMNS = 8 if _MANY else 4
"""Columns of the block that are read side by side."""

WIDE, NARROW = (16, 8) if _MANY else (12, 4)
"""Right-hand sides that are worked on at once: what is not a multiple of the first is done by the second."""

_SUMS = ("contract",)
_INDEX = ir.IntType(64)


def _kernel(width: int, transposed: bool) -> Any:
    """Y = Y - A X, or X = X - A^T Y, for ``width`` right-hand sides.

    Arguments of what is made: the array that A lies in by columns, the place of its first entry, entries from a column
    to the next, and columns, `COLUMNS` at most; the array that X lies in by rows and the place of its first entry; the
    same of Y; rows of A; entries from a row of X, or of Y, to the next. Of X there are `COLUMNS` rows whatever A has:
    further ones must be zero, and are spoilt where X is what changes. All arrays are of one precision.
    """

    @intrinsic
    def product(
        _: Any, A: Any, at: Any, step: Any, columns: Any, X: Any, x: Any, Y: Any, y: Any, rows: Any, row: Any
    ) -> Any:
        number = types.int64
        signature = types.void(A, number, number, number, X, number, Y, number, number, number)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            a, at, step, columns, x_array, x, y_array, y, rows, row = arguments
            places = zip((0, 4, 6), (a, x_array, y_array), (at, x, y), strict=True)
            A, X, Y = (
                builder.gep(context.make_array(signature.args[kind])(context, builder, array).data, [place])
                for kind, array, place in places
            )
            _generate(_Rows(builder, context.get_data_type(signature.args[0].dtype), width, row), transposed)(
                _columns(builder, A, step, columns), X, Y, rows
            )
            return context.get_dummy_value()

        return signature, generate

    return product


class _Rows:
    """Rows of some right-hand sides: where they lie, and how they are loaded into registers, one vector after another.

    Parameters
    ----------
    builder
        Of the code.
    real
        Type of an entry.
    width : int
        Entries of a row.
    step
        Entries from a row to the next.
    """

    def __init__(self, builder: Any, real: Any, width: int, step: Any) -> None:
        self.builder, self._step = builder, step
        self.size = 8 if isinstance(real, ir.DoubleType) else 4
        lanes = _REGISTER // self.size
        starts = range(0, width, lanes)
        self.vectors = [(_index(start), ir.VectorType(real, min(lanes, width - start))) for start in starts]

    def places(self, base: Any, i: Any) -> list[Any]:
        """Where the vectors of row i lie."""
        start = self.builder.gep(base, [self.builder.mul(i, self._step)])
        return [
            self.builder.bitcast(self.builder.gep(start, [first]), vector.as_pointer())
            for first, vector in self.vectors
        ]

    def load(self, places: list[Any]) -> list[Any]:
        """Values of the vectors."""
        return [self.builder.load(place, align=self.size) for place in places]

    def store(self, values: list[Any], places: list[Any]) -> None:
        """Write the vectors."""
        for value, place in zip(values, places, strict=True):
            self.builder.store(value, place, align=self.size)

    def less(self, rows: list[Any], entry: Any, others: list[Any]) -> list[Any]:
        """Vectors of a row, less an entry times those of another."""
        negative, build = self.builder.fneg(entry), self.builder
        return [
            build.fadd(value, build.fmul(self._spread(negative, vector), other, flags=_SUMS), flags=_SUMS)
            for value, other, (_, vector) in zip(rows, others, self.vectors, strict=True)
        ]

    def _spread(self, entry: Any, vector: Any) -> Any:
        nothing = ir.Constant(vector, ir.Undefined)
        first = self.builder.insert_element(nothing, entry, ir.Constant(ir.IntType(32), 0))
        return self.builder.shuffle_vector(
            first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
        )


def _generate(of: _Rows, transposed: bool) -> Callable[[list[Any], Any, Any, Any], None]:
    """Code for the product of columns, given by where each begins."""
    return (_transposed if transposed else _plain)(of)


def _plain(of: _Rows) -> Callable[[list[Any], Any, Any, Any], None]:
    def generate(columns: list[Any], X: Any, Y: Any, rows: Any) -> None:
        known = [of.load(of.places(X, _index(j))) for j in range(COLUMNS)]
        with cgutils.for_range(of.builder, rows) as loop:
            places = of.places(Y, loop.index)
            values = of.load(places)
            for column, others in zip(columns, known, strict=True):
                values = of.less(values, of.builder.load(of.builder.gep(column, [loop.index])), others)
            of.store(values, places)

    return generate


def _transposed(of: _Rows) -> Callable[[list[Any], Any, Any, Any], None]:
    def generate(columns: list[Any], X: Any, Y: Any, rows: Any) -> None:
        builder = of.builder
        places = [of.places(X, _index(j)) for j in range(COLUMNS)]
        # Variables that are only loaded and stored are kept in registers by the compiler.
        sums = [[cgutils.alloca_once_value(builder, value) for value in of.load(each)] for each in places]
        with cgutils.for_range(builder, rows) as loop:
            others = of.load(of.places(Y, loop.index))
            for column, row in zip(columns, sums, strict=True):
                entry = builder.load(builder.gep(column, [loop.index]))
                for variable, value in zip(
                    row, of.less([builder.load(each) for each in row], entry, others), strict=True
                ):
                    builder.store(value, variable)
        for row, each in zip(sums, places, strict=True):
            of.store([builder.load(variable) for variable in row], each)

    return generate


def _columns(builder: Any, A: Any, step: Any, columns: Any) -> list[Any]:
    """Where each column begins; the last one again for those beyond it."""
    last = builder.sub(columns, _index(1))
    found = []
    for j in range(COLUMNS):
        column = builder.select(builder.icmp_signed("<", _index(j), last), _index(j), last)
        found.append(builder.gep(A, [builder.mul(column, step)]))
    return found


def _index(value: int) -> Any:
    return ir.Constant(_INDEX, value)


subtract_wide, subtract_narrow = _kernel(WIDE, False), _kernel(NARROW, False)
transposed_wide, transposed_narrow = _kernel(WIDE, True), _kernel(NARROW, True)
