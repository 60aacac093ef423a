"""Rounding of a body's own numbers: digits of its files, single precision, and parts that cancelled.

Every tolerance on a matrix that was read follows from two figures of the body. ``rounding`` is the error of an entry
relative to the entry: digits that the file lacks. ``noise`` is its error relative to sqrt(K_ii K_jj): the rounding of
larger numbers that cancelled before the entry was stored, as in condensation. The second is measured on rigid motion.
"""

from __future__ import annotations

from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ARITHMETIC",
    "CONDENSATION",
    "DOUBLE",
    "PRINTED",
    "SINGLE",
    "entry_errors",
    "error_of_sum",
    "last_digits",
    "rounding_of_values",
    "spread_noise",
]

Array = NDArray[np.float64]

DOUBLE = 2.0**-53
"""Relative rounding of a double-precision number."""

SINGLE = 2.0**-24
"""Relative rounding of a single-precision number."""

PRINTED = 10.0
"""The rounding of printed digits is relative to the decade of a number; a number with a leading 1 has ten times it."""

# Roundings of binary terms that a sum over many dofs errs by.
_SUMMED = 4.0

ARITHMETIC = 200 * DOUBLE
"""Error of assembly relative to sqrt(K_ii K_jj), which bounds every entry of a semidefinite matrix and is the form of
the error bound of Cholesky factorisation (Higham, Accuracy and Stability, theorem 10.3)."""

CONDENSATION = 1e-9
"""Largest error of condensation relative to sqrt(K_ii K_jj): a slender body subtracts entries that are up to 1e6 times
the result (EA/h against EI/L^3)."""

# Forces of rigid motion above this are no rounding, however they are spread: single precision leaves 1e-7. Rows in a
# wrong order leave 0.2 to 1.2.
_LARGEST_NOISE = 1e-6
# A force of noise is at most this many times the median of its kind; of normal noise in a large body six times.
_OUTLIER = 100.0
# Forces of noise have either sign; those of springs to ground under all nodes have one. The sign is judged where such
# springs could matter: above the noise of condensation.
_ONE_SIGN, _SIGN_DEVIATIONS = 0.9, 6.0
# Fewer nodes show no distribution.
_FEWEST_NODES = 4
# Entries examined for decimal digits, and different ones of them that a judgement needs.
_SAMPLE, _FEWEST_VALUES = 4000, 4
# Rounding to d digits leaves d digits in nine numbers of ten. Products of typed numbers vary in their digits.
_ALIKE = 0.7
# Fewer digits are typed, unless many numbers have them; more are those of a double.
_FEWEST_DIGITS, _MOST_DIGITS = 6, 14
_FEW_DIGITS, _MANY_VALUES = 4, 100
# Bits of the exponent of a double.
_EXPONENT = 0x7FF << 52
# Bits of the mantissa of a single-precision number. A shorter number may be exact; a number that was rounded needs all
# but the last few.
_SINGLE_BITS, _LONG_BITS, _LONG_SHARE = 24, 20, 0.5
# Twelve printed digits or more leave a single-precision number so near to itself, and hardly any other number.
_PRINTED_SINGLE = 1e-11


def rounding_of_values(values: Array, *, few: bool = False) -> float:
    """Rounding that the stored numbers of a matrix show, whatever the type of its file.

    Parameters
    ----------
    values : (k,) float64
        Entries as read.
    few : bool
        True to believe less than six digits, too, if a hundred different numbers have them.

    Returns
    -------
    float
        ``SINGLE`` if all are single-precision numbers, half a unit of the last of d decimal digits if all have d
        digits, else ``DOUBLE``. Short numbers, such as 3e7 or 0.125, may be exact and prove nothing.

    Examples
    --------
    >>> rounding_of_values(np.float64(np.float32([0.1, 0.2 / 3, 1 / 7, 7.3]))) == SINGLE
    True
    >>> rounding_of_values(np.array([0.1234567891, 31.41592654, 2.718281828, 1.414213562]))
    5e-11
    >>> rounding_of_values(np.array([12.0, 6.0, 4.0, 3.5e7])) == DOUBLE
    True
    """
    # Of a matrix that stores few zeros a part shows enough: to look through all of it takes as long as to read it.
    sample = _entries(values[:: max(1, values.size // _SAMPLE)])
    if 2 * sample.size < _SAMPLE:
        values = _entries(values)
        sample = values[:: max(1, values.size // _SAMPLE)]
    sample = np.unique(abs(sample))
    if sample.size < _FEWEST_VALUES:
        return DOUBLE
    return SINGLE if _are_single(sample, values) else _decimal_rounding(sample, few)


def _entries(values: Array) -> Array:
    return np.asarray(values[np.isfinite(values) & (values != 0)])


def _are_single(sample: Array, values: Array) -> bool:
    """True if all values are single-precision numbers, and many of the sample need its bits."""
    if not _fit_single(sample):
        return False
    # What is left where entries cancelled, as along the axes of a regular mesh, is an exact short number.
    firm = sample[sample > ARITHMETIC * sample.max()]
    return (_need_single(sample) or _need_single(firm)) and _fit_single(values)


def _need_single(sample: Array) -> bool:
    """True if many numbers need the bits of single precision."""
    mantissa = np.round(np.frexp(sample)[0] * 2.0**_SINGLE_BITS).astype(np.int64)
    used = _SINGLE_BITS - np.log2((mantissa & -mantissa).astype(np.float64))
    # An integer below 2^24 is a single-precision number by itself.
    long = (used >= _LONG_BITS) & ((sample != np.round(sample)) | (sample > 2.0**_SINGLE_BITS))
    return bool(np.unique(mantissa[long]).size >= _FEWEST_VALUES and long.mean() >= _LONG_SHARE)


def _fit_single(values: Array) -> bool:
    with np.errstate(over="ignore"):
        return bool((abs(values.astype(np.float32) - values) <= _PRINTED_SINGLE * abs(values)).all())


def _decimal_rounding(sample: Array, few: bool) -> float:
    """Half a unit of the last digit if most numbers have the same number of decimal digits and none has more."""
    # Multiples by ten are one number.
    lengths: dict[str, int] = {}
    for value in sample.tolist():
        digits = repr(value).split("e")[0].replace(".", "").strip("0")
        if len(digits) > _MOST_DIGITS:
            return DOUBLE
        # An integer to its last digit may be exact.
        if not value.is_integer() or value % 10 == 0:
            lengths[digits] = len(digits)
    of_all = np.array(list(lengths.values()))
    most = int(of_all.max(initial=0))
    alike = of_all.size >= _FEWEST_VALUES and np.mean(of_all == most) >= _ALIKE
    fewest = _FEW_DIGITS if few and of_all.size >= _MANY_VALUES else _FEWEST_DIGITS
    return 0.5 * 10.0**-most if alike and most >= fewest else DOUBLE


def last_digits(values: Array) -> tuple[float, int] | None:
    """Unit of the last decimal place of all numbers, and the largest number of significant digits of one of them.

    Returns
    -------
    tuple of float and int, or None
        None if one of the numbers has all digits of a double, or there is none.

    Examples
    --------
    >>> last_digits(np.array([1200.0, -350.0, 0.0])), last_digits(np.array([0.25, 1.5, 40.0]))
    ((10.0, 2), (0.01, 2))
    """
    places, most = [], 0
    for value in np.unique(abs(values[values != 0])).tolist():
        _, digits, place = Decimal(repr(value)).normalize().as_tuple()
        if len(digits) > _MOST_DIGITS:
            return None
        places.append(int(place))
        most = max(most, len(digits))
    return (float(f"1e{min(places)}"), most) if places else None


def error_of_sum(rounding: float) -> float:
    """Error of a sum of many terms, relative to the sum of their sizes.

    Parameters
    ----------
    rounding : float
        Relative rounding of the terms; a power of two is one of binary numbers, any other one of decimal digits.

    Examples
    --------
    >>> error_of_sum(5e-9)
    5e-08
    """
    binary = float(np.frexp(rounding)[0]) == 0.5
    return (_SUMMED if binary or rounding < DOUBLE else PRINTED) * max(rounding, DOUBLE)


def entry_errors(values: Array, rounding: float) -> Array:
    """Largest error of each number by its rounding: half a unit of its last digit.

    Parameters
    ----------
    values : float64 array
        Numbers.
    rounding : float
        Relative rounding; a power of two is one of binary numbers, any other one of decimal digits.

    Examples
    --------
    >>> entry_errors(np.array([1.5, 950.0]), 5e-4).tolist()
    [0.005, 0.5]
    """
    values = np.asarray(values, dtype=np.float64)
    if float(np.frexp(rounding)[0]) == 0.5:
        # The last place of a binary number is the same from one power of two to the next: its bits of the exponent.
        errors = (values.view(np.int64) & _EXPONENT).view(np.float64)
        errors *= rounding
        return errors
    size = abs(values)
    decade = np.zeros_like(size)
    decade[size > 0] = 10.0 ** np.floor(np.log10(size[size > 0]))
    return PRINTED * rounding * decade


def spread_noise(
    force: Array, sizes: tuple[Array, ...], shapes: Array, node: NDArray[np.int64]
) -> tuple[float, int] | None:
    """Estimate the noise of a stiffness matrix from the forces that it leaves under rigid motion.

    Noise loads all nodes alike, in proportion to their stiffness. A spring to ground loads one node, and rows in a
    wrong order cause forces as large as the stiffness.

    Parameters
    ----------
    force : (n, m) float64
        K R under rigid motions.
    sizes : tuple of (n, m) float64
        Forces that an error of one would cause in each row, by different kinds of noise.
    shapes : (n, m) float64
        R.
    node : (n,) int64
        Node of each row.

    Returns
    -------
    level : float
        Largest error of this kind that noise explains, relative to ``sizes``.
    kind : int
        The one of ``sizes`` that fits best. None instead of both if the forces are not spread, or too large.
    """
    _, at = np.unique(node, return_inverse=True)
    count = int(at.max(initial=-1)) + 1
    best: tuple[float, float, int] | None = None
    for kind, size in enumerate(sizes):
        share = np.divide(abs(force), size, out=np.zeros_like(force), where=size > 0).max(axis=1, initial=0.0)
        of_node = np.zeros(count)
        np.maximum.at(of_node, at, share)
        low, typical, high = np.quantile(of_node, (0.25, 0.5, 0.75), method="lower") if count else (0.0, 0.0, 0.0)
        if not 0 < typical <= _LARGEST_NOISE:
            continue
        usual = (share <= _OUTLIER * typical)[:, None]
        if typical > CONDENSATION and (count < _FEWEST_NODES or _of_one_sign(force * usual, shapes)):
            continue
        # A fault loads few nodes, so that the middle half of them shows the kind of noise.
        width = float(high / low) if low > 0 else np.inf
        if best is None or width < best[0]:
            best = width, float(min(_OUTLIER * typical, _LARGEST_NOISE)), kind
    return None if best is None else best[1:]


def _of_one_sign(force: Array, shapes: Array) -> bool:
    """True if the forces resist a motion all over the body, as springs to ground do, or push it, as spin does."""
    work = force * shapes
    loaded = np.count_nonzero(work, axis=0)
    total = abs(work).sum(axis=0)
    limit = np.minimum(_ONE_SIGN, _SIGN_DEVIATIONS / np.sqrt(np.maximum(loaded, 1)))
    return bool((abs(work.sum(axis=0)) > limit * total)[total > 0].any())
