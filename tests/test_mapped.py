"""A compiled function over many columns: the same numbers as CasADi's own call, sizes checked."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pneuid.mapped import Mapped, Trajectories

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


# --- in a row ---


def _trajectory() -> ca.Function:
    """Two samples of a state that turns and is driven by the data, by the angle ``theta``."""
    s, data, theta = ca.SX.sym("s", 2), ca.SX.sym("data", 1, 2), ca.SX.sym("theta", 1)
    states = [s]
    for k in range(2):
        x, y = states[-1][0], states[-1][1]
        states.append(ca.vertcat(ca.cos(theta) * x - ca.sin(theta) * y + data[k], ca.sin(theta) * x + ca.cos(theta) * y))
    outputs = ca.horzcat(*(state[0] for state in states[:-1]))
    return ca.Function("trajectory", [s, data, theta], [outputs, ca.horzcat(*states)])


@pytest.mark.parametrize("threads", [1, 2])
@given(lengths=st.lists(st.integers(1, 6), min_size=1, max_size=20), seed=st.integers(0, 1000))
def test_every_interval_starts_where_the_one_before_it_ended(threads, lengths, seed):
    function, rng, count = _trajectory(), np.random.default_rng(seed), sum(lengths)
    start, data, theta = rng.normal(size=(2, len(lengths))), rng.normal(size=(1, 2 * count)), rng.normal(size=(1, count))
    outputs, states = Trajectories(function, np.array(lengths), threads)(start, data, theta)
    i = 0
    for window, length in enumerate(lengths):
        s = start[:, window]
        for _ in range(length):
            shown, passed = (np.asarray(item) for item in function(s, data[:, 2 * i : 2 * i + 2], theta[:, i]))
            np.testing.assert_array_equal(outputs[i].T, shown)
            np.testing.assert_array_equal(states[i].T, passed)
            s, i = passed[:, -1], i + 1
