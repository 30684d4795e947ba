"""The friction-compensating servo: cascade, pressure-aware LuGre observer and residual force.

The bristle's force is cancelled up to the share ``alpha``; the extended state observer finds the rest. Cancelling all
of a friction that was identified a little too large makes limit cycles of half a millimetre, so ``alpha`` stays
below one.
Source: Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419, section V (observer-based compensation).
"""

from __future__ import annotations

from typing import Any

from controllers.cascade import Cascade, CascadeGains
from controllers.control_model import Instant


class Servo(Cascade):
    """The cascade with the LuGre observer's force and the residual cancelled."""

    name = "servo"

    def compensation(self, now: Instant, residual: Any, gains: CascadeGains) -> Any:
        """Share ``alpha`` of the bristle's force plus the residual."""
        return gains.alpha * now.friction + residual
