"""Readers that a library's fault could look like, in place of those of two formats; for the reading process of a test."""

from __future__ import annotations

import os
import time
from pathlib import Path

from pneuid.formats import READERS, FileLayout, RawTable


def _abort(path: Path, layout: FileLayout) -> RawTable:
    os.abort()


def _hang(path: Path, layout: FileLayout) -> RawTable:
    time.sleep(600)
    raise AssertionError("nobody ended it")


READERS[".tdms"], READERS[".mf4"] = _abort, _hang
