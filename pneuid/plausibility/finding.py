"""What a sanity check reports: what was seen, what is suspected and what to do. Data are never changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pneuid.recording import Recording
from pneuid.rig import Rig


@dataclass(frozen=True)
class Finding:
    """One suspicion about the recordings as handed in.

    ``check``: name in the registry; ``signal``: the signal it is about; ``seen``: the evidence with numbers and units;
    ``suspected``: the slip that would explain it; ``advice``: what to look at or write.
    """

    check: str
    signal: str
    seen: str
    suspected: str
    advice: str

    @property
    def line(self) -> str:
        """The finding in one line for a terminal."""
        return f"{self.signal}: {self.seen}; suspected: {self.suspected}; {self.advice}"


Check = Callable[[Rig, Sequence[Recording]], Finding | None]
"""A sanity check over a rig and its recordings (at least one); None where there is nothing to report or nothing to tell by."""
