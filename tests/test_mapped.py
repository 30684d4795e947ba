"""A compiled function over many columns: the same numbers as CasADi's own call, sizes checked."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pneuid.mapped import Mapped

finite = st.floats(-1e6, 1e6)


def _function() -> ca.Function:
    s, data = ca.SX.sym("s", 2), ca.SX.sym("data", 3, 4)
    return ca.Function("f", [s, data], [s * ca.sum1(ca.sum2(data)), ca.mtimes(data.T, data) + s[0], data[0, 0] - s[1]])


@pytest.mark.parametrize("threads", [1, 2])
@given(data=st.data(), count=st.one_of(st.integers(1, 5), st.integers(30, 40)))
def test_the_same_as_casadis_own_call(threads, data, count):
    function = _function()
    s = data.draw(hnp.arrays(float, (2, count), elements=finite))
    columns = data.draw(hnp.arrays(float, (3, 4 * count), elements=finite))
    found = Mapped(function, count, threads)(s, columns)
    expected = function.map(count)(s, columns) if count > 1 else function(s, columns)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, np.asarray(other))


def test_any_memory_order_goes_in():
    wide = np.arange(48.0).reshape(6, 8)
    run = Mapped(_function(), 2)
    s = np.array([[1.0, 2.0], [3.0, 4.0]])
    for view in (wide[::2], np.asfortranarray(wide[::2]), wide[::2].astype(int)):
        np.testing.assert_array_equal(run(s, view)[1], run(s, wide[::2].copy())[1])


def test_a_result_is_not_overwritten_by_the_next_call():
    run, s = Mapped(_function(), 1), np.ones(2)
    first = run(s, np.ones((3, 4)))[0]
    kept = first.copy()
    run(s, np.full((3, 4), 7.0))
    np.testing.assert_array_equal(first, kept)


@pytest.mark.parametrize("columns", [3, 9])
def test_another_size_is_refused(columns):
    with pytest.raises(ValueError, match=r"input 1 of .* numbers; 24 are needed"):
        Mapped(_function(), 2)(np.ones((2, 2)), np.ones((3, columns)))
