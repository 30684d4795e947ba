"""The likeliest ways to the exact fit, by which a diagnosis soon decides whether a model is right."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pneuid.estimation import exact_end
from pneuid.estimation.solver import Outcome
from pneuid.estimation.stages import Relaxed


def test_a_fit_that_is_followed_soon_gives_up_where_windows_cost_more_than_a_whole_path_may(monkeypatch):
    given = []
    monkeypatch.setattr(exact_end, "exact_by_windows", lambda *args: (given.append(args[-1]), (None, None))[1])
    assert _likely(monkeypatch, False, exact_stage=None, starts=1) == (None, ["exact_stage"])
    assert given == [1.0]


@pytest.mark.parametrize(
    ("within", "found", "hard", "tried"),
    [
        (True, {"exact_directly": "D"}, "D", ["exact_directly"]),  # what is straight and near may be all that is needed
        (True, {"exact_past_slips": "S", "exact_by_windows": "W"}, "S", ["exact_directly", "exact_past_slips"]),
        (True, {"exact_by_windows": "W"}, "W", ["exact_directly", "exact_past_slips", "exact_by_windows"]),
        (False, {"exact_directly": "D", "exact_stage": "G"}, None, ["exact_by_windows", "exact_by_windows"]),
        (False, {"exact_by_windows": "W"}, "W", ["exact_by_windows"]),
    ],
)
def test_a_fit_that_is_followed_soon_goes_the_likeliest_ways(within, found, hard, tried, monkeypatch):
    ways = dict.fromkeys(("exact_directly", "exact_past_slips", "exact_by_windows", "exact_stage")) | found
    assert _likely(monkeypatch, within, starts=2, **ways) == (hard, tried)


def _likely(monkeypatch, within: bool, starts: int, **ways: str | None):
    """Where ``likely_end`` leads when the ways lead where their words say, and the ways tried; ``starts`` of windows."""
    tried: list[str] = []

    def way(name: str, leads: str | None):
        return lambda *_: (tried.append(name), (leads, None) if name == "exact_by_windows" else leads)[1]

    for name, leads in ways.items():
        monkeypatch.setattr(exact_end, name, way(name, leads))
    monkeypatch.setenv("PNEUID_THREADS", "1")
    monkeypatch.setattr(exact_end, "within_reach", lambda *_: within)
    monkeypatch.setattr(exact_end, "window_starts", lambda *_: [np.zeros(1)] * starts)
    monkeypatch.setattr(exact_end.End, "near", True)
    soft = Relaxed(Outcome(np.zeros(1), 1.0, 0.0, "", True, 1, 0.0), 0.1, 1.0)
    problem = SimpleNamespace(plant=None, runs=())
    return exact_end.likely_end(SimpleNamespace(monitor=None), problem, soft).hard, tried
