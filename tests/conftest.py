"""Settings for every test: no window, no deadline on shared cores, the same examples each time."""

from __future__ import annotations

import os

os.environ.setdefault("MPLBACKEND", "Agg")
# each test process of pytest -n 2 has one core; before numpy, numba and casadi start their threads
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest  # noqa: E402 - the environment comes first
from hypothesis import settings  # noqa: E402

from pneuid.criticism.decision import acceptance, all_runs  # noqa: E402

settings.register_profile("pneuid", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("pneuid")


@pytest.fixture
def amplitudes_inside(monkeypatch):
    """Trials that are a few numbers have no amplitudes that could lie on their bounds, or be shorter than a sample."""
    monkeypatch.setattr(acceptance, "inside_bounds", lambda *_: True)
    monkeypatch.setattr(acceptance, "unresolved", lambda *_: False)
    monkeypatch.setattr(all_runs, "inside_bounds", lambda *_: True)
