"""Blocks of vectors: products with tall and sparse matrices, and bases in memory or on disk.

Products, orthonormal columns and layouts belong here: code that is as fast as the memory.
Factorisations belong in `sparse`, searches for modes in `eigen`, the files of mapped arrays in `model`.
"""

from cmsreduce.linalg.blocks.basis import (
    SearchSpace,
    absolute_parts,
    combine,
    combined,
    new_basis,
    observed,
    outgrows,
    row_blocks,
    side_by_side,
    skew_congruence,
)
from cmsreduce.linalg.blocks.products import (
    Product,
    Rows,
    absolute_product,
    column_blocks,
    congruence,
    entrywise_product,
    one_norm,
    rows_of,
    symmetric_product,
    unchanged_in,
)
from cmsreduce.linalg.blocks.singular_vectors import svd
from cmsreduce.linalg.blocks.tall_blocks import (
    by_columns,
    by_rows,
    column_products,
    dense,
    inner,
    inner_of_all,
    less,
    less_all,
    put,
    times,
)

__all__ = [
    "Product",
    "Rows",
    "SearchSpace",
    "absolute_parts",
    "absolute_product",
    "by_columns",
    "by_rows",
    "column_blocks",
    "column_products",
    "combine",
    "combined",
    "congruence",
    "dense",
    "entrywise_product",
    "inner",
    "inner_of_all",
    "less",
    "less_all",
    "new_basis",
    "observed",
    "one_norm",
    "outgrows",
    "put",
    "row_blocks",
    "rows_of",
    "side_by_side",
    "skew_congruence",
    "svd",
    "symmetric_product",
    "times",
    "unchanged_in",
]
