"""Many printed numbers at once, against Python's own reading of each."""

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cmsreduce.read.numbers_at_once import REAL, integers_of, numbers_of, reals_of
from cmsreduce.read.printed_numbers import real_number

VALUES = st.floats(allow_nan=False, allow_subnormal=True)
PRINTS = ["{:.16e}", "{:+.9E}", "{!r}", "{:.3g}", "{:24.13e}", "{:.1f}"]
FORTRAN = [lambda text: text, lambda text: text.replace("e", "D"), lambda text: re.sub("[eE](?=[+-])", "", text)]


@given(st.lists(st.tuples(VALUES, st.sampled_from(PRINTS), st.sampled_from(FORTRAN), st.sampled_from(" \t,\n"))))
def test_each_number_is_the_nearest_double(numbers: list) -> None:
    words = [(fortran(form.format(value)).strip(), gap) for value, form, fortran, gap in numbers]
    found = numbers_of("".join(word + gap for word, gap in words).encode())
    named = {"inf": np.inf, "-inf": -np.inf, "+inf": np.inf, "INF": np.inf, "-INF": -np.inf, "+INF": np.inf}
    assert found.tolist() == [named.get(word, real_number(word)) for word, _ in words]


@given(st.text("0123456789+-.eEdD nif", max_size=12))
def test_the_grammar_takes_what_is_a_number(word: str) -> None:
    taken = re.fullmatch(REAL, word) is not None
    try:
        value = float(word) if word.strip() == word else None
    except ValueError:
        value = real_number(word) if word.strip() == word else None
    assert taken == (value is not None)
    if taken:
        assert np.array_equal(numbers_of(word.encode()), [value], equal_nan=True)


@given(st.lists(st.text("00123456789+-.eEdD n", max_size=18), min_size=1, max_size=6), st.booleans())
def test_a_field_has_the_number_that_its_word_is(words: list, wide: bool) -> None:
    words = [f"{word}{'9' * 12 if wide else ''}" for word in words]
    fields = np.array([list(word.center(32).encode()) for word in words], dtype=np.uint8)
    found, sure = reals_of(fields)
    expected = [real_number(word) if " " not in word.strip() else None for word in words]
    assert sure.tolist() == [value is not None for value in expected]
    assert found.tobytes() == np.array([0.0 if value is None else value for value in expected]).tobytes()
    integers, whole = integers_of(fields)
    are_whole = [re.fullmatch(r" *[+-]?\d{1,15} *", word) is not None for word in words]
    assert whole.tolist() == are_whole
    assert integers.tolist() == [int(word) if yes else 0 for word, yes in zip(words, are_whole, strict=True)]
