"""How many cores one computation takes."""

from __future__ import annotations

import os

from threadpoolctl import threadpool_limits


def threads() -> int:
    """Threads of one evaluation: every core, or what PNEUID_THREADS says (1 where processes run side by side)."""
    stated = os.environ.get("PNEUID_THREADS", "")
    return max(1, int(stated)) if stated.isdigit() else min(os.cpu_count() or 1, 8)


small_matrices = threadpool_limits.wrap(limits=1, user_api="blas")
"""Decorator: in the function a product or a factorisation takes one core; these are so small that others would only wait for
them: 3 to 9 s of a diagnosis of 109 s."""
