"""What the ranking says of an effect, against the definitions worked out by hand."""

from __future__ import annotations

import math

import pytest
from trials import score, stub

from pneuid.criticism.decision.evidence import as_refitted, chance, leading


def test_the_p_value_is_that_of_the_likelihood_ratio():
    # one degree of freedom: chi-square of twice the drop is the square of a normal deviate
    drop = 2.0
    assert chance(score("gravity", drop), stub(2.0, 998.0), stub(9.0, 1000.0)) == pytest.approx(math.erfc(math.sqrt(drop)))


def test_a_refit_that_costs_more_is_no_evidence():
    assert chance(score("gravity", 2.0), stub(2.0, 1001.0), stub(9.0, 1000.0)) == 1.0


def test_errors_are_squared_in_trials_and_plain_in_the_ranking():
    said = as_refitted(score("gravity", 500.0), stub(4.0, 500.0), stub(16.0, 1000.0), stub(31.0, 1200.0))
    assert said.hold_out_error_ratio == pytest.approx(0.5)
    assert said.excess_explained == pytest.approx((16.0 - 4.0) / (31.0 - 1.0))


def test_a_model_that_cannot_be_simulated_has_no_error_ratio():
    said = as_refitted(score("gravity", 500.0), stub(math.inf, 500.0), stub(16.0, 1000.0), stub(31.0, 1200.0))
    assert said.hold_out_error_ratio is None and said.excess_explained == 0.0


def test_three_lead_the_words():
    said = leading([score(name, 1e3) for name in ("gravity", "backlash", "load_mass", "line_delay")])
    assert all(name in said for name in ("gravity", "backlash", "load_mass")) and "line_delay" not in said
    assert "no candidate" in leading([])
