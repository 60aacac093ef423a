"""Code for products of a few columns with a few right-hand sides, which stay in registers while rows pass by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = [
    "COLUMNS",
    "NARROW",
    "WIDE",
    "row_subtract_narrow",
    "row_subtract_wide",
    "row_transposed_narrow",
    "row_transposed_wide",
    "sparse_narrow",
    "sparse_wide",
    "subtract_narrow",
    "subtract_wide",
    "transposed_narrow",
    "transposed_wide",
]

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


def _kernel(width: int, transposed: bool, by_rows: bool = False) -> Any:
    """Y = Y - A X, or X = X - A^T Y, for ``width`` right-hand sides.

    Arguments of what is made: the array that A lies in, by columns or by rows, the place of its first entry, entries
    from a column, or a row, to the next, and columns, `COLUMNS` at most; the array that X lies in by rows and the place
    of its first entry; the same of Y; rows of A; entries from a row of X, or of Y, to the next. Of X there are
    `COLUMNS` rows whatever A has: further ones must be zero, and are spoilt where X is what changes. All arrays are of
    one precision.
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
                _Columns(builder, A, step, columns, by_rows), X, Y, rows
            )
            return context.get_dummy_value()

        return signature, generate

    return product


def _sparse_kernel(width: int) -> Any:
    """Y = a X, for a sparse row a and ``width`` right-hand sides.

    Arguments of what is made: the arrays of entries and of their columns, and the places in them of the first entry and
    of the one after the last; the array that X lies in by rows and the place of its first entry; the same of y; entries
    from a row of X to the next.
    """

    @intrinsic
    def product(
        _: Any, entries: Any, columns: Any, first: Any, last: Any, X: Any, x: Any, Y: Any, y: Any, row: Any
    ) -> Any:
        number = types.int64
        signature = types.void(entries, columns, number, number, X, number, Y, number, number)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            entries, columns, first, last, x_array, x, y_array, y, row = arguments
            E, J, X, Y = (
                context.make_array(signature.args[kind])(context, builder, array).data
                for kind, array in zip((0, 1, 4, 6), (entries, columns, x_array, y_array), strict=True)
            )
            X, Y = builder.gep(X, [x]), builder.gep(Y, [y])
            of = _Rows(builder, context.get_data_type(signature.args[0].dtype), width, row)
            sums = [
                cgutils.alloca_once_value(builder, ir.Constant(vector, [0.0] * vector.count))
                for _, vector in of.vectors
            ]
            with cgutils.for_range(builder, builder.sub(last, first)) as loop:
                place = builder.add(first, loop.index)
                column = builder.load(builder.gep(J, [place]))
                if column.type.width < _INDEX.width:
                    column = builder.sext(column, _INDEX)
                negative = builder.fneg(builder.load(builder.gep(E, [place])))
                values = of.less([builder.load(each) for each in sums], negative, of.load(of.places(X, column)))
                for variable, value in zip(sums, values, strict=True):
                    builder.store(value, variable)
            of.store([builder.load(each) for each in sums], of.places(Y, _index(0)))
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


class _Columns:
    """Columns of a block, `COLUMNS` of them: the last one again for those beyond it."""

    def __init__(self, builder: Any, A: Any, step: Any, columns: Any, by_rows: bool) -> None:
        self._builder, self._down, self._starts = builder, step if by_rows else _index(1), []
        last = builder.sub(columns, _index(1))
        for j in range(COLUMNS):
            column = builder.select(builder.icmp_signed("<", _index(j), last), _index(j), last)
            self._starts.append(builder.gep(A, [column if by_rows else builder.mul(column, step)]))

    def load(self, i: Any) -> Iterator[Any]:
        """Entries of row i, each when it is asked for."""
        place = self._builder.mul(i, self._down)
        return (self._builder.load(self._builder.gep(start, [place])) for start in self._starts)


def _generate(of: _Rows, transposed: bool) -> Callable[[_Columns, Any, Any, Any], None]:
    """Code for the product of columns."""
    return (_transposed if transposed else _plain)(of)


def _plain(of: _Rows) -> Callable[[_Columns, Any, Any, Any], None]:
    def generate(columns: _Columns, X: Any, Y: Any, rows: Any) -> None:
        known = [of.load(of.places(X, _index(j))) for j in range(COLUMNS)]
        with cgutils.for_range(of.builder, rows) as loop:
            places = of.places(Y, loop.index)
            values = of.load(places)
            for entry, others in zip(columns.load(loop.index), known, strict=True):
                values = of.less(values, entry, others)
            of.store(values, places)

    return generate


def _transposed(of: _Rows) -> Callable[[_Columns, Any, Any, Any], None]:
    def generate(columns: _Columns, X: Any, Y: Any, rows: Any) -> None:
        builder = of.builder
        places = [of.places(X, _index(j)) for j in range(COLUMNS)]
        # Variables that are only loaded and stored are kept in registers by the compiler.
        sums = [[cgutils.alloca_once_value(builder, value) for value in of.load(each)] for each in places]
        with cgutils.for_range(builder, rows) as loop:
            others = of.load(of.places(Y, loop.index))
            for entry, row in zip(columns.load(loop.index), sums, strict=True):
                values = of.less([builder.load(each) for each in row], entry, others)
                for variable, value in zip(row, values, strict=True):
                    builder.store(value, variable)
        for row, each in zip(sums, places, strict=True):
            of.store([builder.load(variable) for variable in row], each)

    return generate


def _index(value: int) -> Any:
    return ir.Constant(_INDEX, value)


subtract_wide, subtract_narrow = _kernel(WIDE, False), _kernel(NARROW, False)
transposed_wide, transposed_narrow = _kernel(WIDE, True), _kernel(NARROW, True)
row_subtract_wide, row_subtract_narrow = _kernel(WIDE, False, by_rows=True), _kernel(NARROW, False, by_rows=True)
row_transposed_wide, row_transposed_narrow = _kernel(WIDE, True, by_rows=True), _kernel(NARROW, True, by_rows=True)
sparse_wide, sparse_narrow = _sparse_kernel(WIDE), _sparse_kernel(NARROW)
