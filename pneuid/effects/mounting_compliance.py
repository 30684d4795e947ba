"""A cylinder body that moves on an elastic mount."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State, integrated
from pneuid.physics import motion
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Den Hartog, Mechanical Vibrations (4th ed., McGraw-Hill 1956), section 3.2 (two degrees of freedom)"

_LOOKS = tuple({"w_mount": 40.0 * 1.2**k, "read_mount": r} for r in (0.0, 1.0) for k in range(14))
"""Natural frequencies in rad/s, 40 to 430, so close that a mount of usual damping swings along with one of them; the position
sensor on the body or on the machine."""


class MountingCompliance(Effect):
    """Body of mass ``m/mu`` on a mount of natural frequency ``w`` and damping ratio ``zeta``; ``x`` is the piston's way in it.

    A position sensor on the body shows ``x``, one on the machine ``x + mu q``, one on a bracket between ``x + r mu q``. The
    body's displacement is ``mu q`` with ``q'' = -R/m - w^2 q - 2 zeta w q'`` and ``R`` the force of air, friction and end stops
    on the piston; the load feels ``-m mu q''``. Typical: mu 0.1 to 1, w 60 to 400 rad/s (10 to 60 Hz), zeta 0.02 to 0.2.
    """

    name = "mounting_compliance"
    mechanism = "the cylinder body sits on a soft mount or frame and recoils when the load is accelerated"
    equation = "force"
    reference = _SOURCE
    experiment = "fast reversals: steps or a sweep over the mount's natural frequency"
    confused_with = ("load_mass", "backlash")
    rigs = ("servo",)
    looks = _LOOKS
    states = (State("recoil", "m", 0.0, 2e-3, 1e-3), State("recoil_speed", "m/s", 0.0, 0.2, 5e-2))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Moving mass over body mass, natural frequency and damping ratio of the mount, share of the recoil in the reading."""
        return (
            Parameter("mu_mount", "μ", "1", 0.0, 5.0, 0.0, 0.1, _SOURCE, off=0.0),
            Parameter("w_mount", "ω", "rad/s", 20.0, 600.0, 120.0, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("zeta_mount", "ζ", "1", 0.01, 1.0, 0.08, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("read_mount", "r", "1", 0.0, 1.0, 0.5, 0.3, _SOURCE),
        )

    def _pull(self, scope: Scope) -> Expression:
        """Acceleration of ``q`` by the mount alone, m/s^2."""
        w, q, speed = scope.p.w_mount, scope.state.recoil, scope.state.recoil_speed
        return -w * w * q - 2.0 * scope.p.zeta_mount * w * speed

    def _driving(self, scope: Scope) -> Expression:
        """Force of air, friction and end stops on the piston, N: what it pushes the body with."""
        rig = scope.rig
        air = motion.pressure_force(scope.p1, scope.p2, rig.A1, rig.A2, rig.patm)
        return air - scope.friction - motion.end_stop_force(scope.x, scope.v, rig.stroke)

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add the inertia force of the load in the moving frame."""
        return force + scope.p.mu_mount * (self._driving(scope) - scope.mass * self._pull(scope))

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Add what a position sensor sees of the body's displacement."""
        if signal != "x":
            return value
        return value + scope.p.read_mount * scope.p.mu_mount * scope.state.recoil

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The body on its mount, driven by the reaction; its damping is taken exactly."""
        w = scope.p.w_mount
        damping = 2.0 * scope.p.zeta_mount * w
        target = (-self._driving(scope) / scope.mass - w * w * scope.state.recoil) / damping
        return {
            "recoil": integrated(scope.state.recoil, scope.state.recoil_speed),
            "recoil_speed": (target, 1.0 / damping),
        }
