"""Pools: what is not waited for any more is not computed."""

from __future__ import annotations

import time
from pathlib import Path

from pneuid.cores import threads
from pneuid.pool import open_pool

MANY = 40


def _marked(path: Path) -> str:
    time.sleep(0.1)
    path.touch()
    return path.name


def test_tasks_that_nobody_waits_for_are_not_begun(tmp_path):
    with open_pool(2) as pool:
        place, name = next(coming := pool.each(_marked, [tmp_path / str(i) for i in range(MANY)]))
        del coming
        assert name == str(place)
        assert list(pool.each(_marked, [tmp_path / "afterwards"])) == [(0, "afterwards")]
    begun = {path.name for path in tmp_path.iterdir()} - {"afterwards"}
    assert name in begun and len(begun) < MANY / 2  # what runs, or is handed over already, is finished


def _cores(_: int) -> int:
    return threads()


def test_processes_share_the_cores(monkeypatch):
    monkeypatch.delenv("PNEUID_THREADS", raising=False)
    monkeypatch.setattr("os.cpu_count", lambda: 6)
    with open_pool(3) as pool:
        assert dict(pool.each(_cores, range(3))) == {0: 2, 1: 2, 2: 2}
