"""How many cores one computation takes."""

from __future__ import annotations

import os


def threads() -> int:
    """Threads of one evaluation: every core, or what PNEUID_THREADS says (1 where processes run side by side)."""
    stated = os.environ.get("PNEUID_THREADS", "")
    return max(1, int(stated)) if stated.isdigit() else min(os.cpu_count() or 1, 8)
