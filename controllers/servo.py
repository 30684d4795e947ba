"""The friction-compensating servo: cascade, pressure-aware LuGre observer and residual force.

The bristle's force is cancelled up to the share ``alpha``; the extended state observer finds the rest. Cancelling all
of a friction that was identified a little too large makes limit cycles of half a millimetre, so ``alpha`` stays
below one.
Source: Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419, section V (observer-based compensation).
"""

from __future__ import annotations

from controllers.cascade import Cascade, Compensation, FrictionEstimate


class Servo(Cascade):
    """The cascade with the LuGre observer's force and the residual cancelled."""

    name = "servo"

    def compensation(self, friction: FrictionEstimate) -> Compensation:
        """The believed share of the model's friction plus the residual."""
        return Compensation(friction.believed + friction.residual, friction.believed_rate)
