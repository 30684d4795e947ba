"""Friction laws carried by one bristle: LuGre and its static or rate-free special cases.

``F = sigma0 z + sigma1 dz/dt + sigma2 v`` with ``dz/dt = v - sigma0 |v| / g(v) z`` and
``g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)``. Source: Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40 (1995) 419,
eq. (1)-(4), with ``g`` in N.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from pneuid.physics.smoothing import Expression, absolute, slip_speed

CARRIER_FREQUENCY = 1.0e3
"""Natural frequency in rad/s of the moving mass on the stiff bristle that carries a static law on a servo rig."""

CARRIER_DAMPING_RATIO = 0.7
"""Damping ratio of that bristle; sliding does not feel it, sticking does not ring."""

CARRIER_STIFFNESS_BENCH = 1.0e7
"""Stiffness in N/m of that bristle where the motion is imposed (no natural frequency to respect)."""


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of one friction law at one operating point (N, N, m/s, N/m, N s/m, N s/m)."""

    Fc: Expression
    Fs: Expression
    vs: Expression
    sigma0: Expression
    sigma1: Expression
    sigma2: Expression


@dataclass(frozen=True)
class FrictionLaw:
    """A friction law: which of the six coefficients it fits, and how the others follow from them.

    ``fitted`` names the fitted ones in the order of ``Coefficients``; a static law is carried by a stiff bristle so
    that it can stick and be integrated.
    """

    name: str
    fitted: tuple[str, ...]
    static: bool

    def coefficients(
        self, values: dict[str, Expression], carrier_stiffness: Expression, carrier_damping: Expression
    ) -> Coefficients:
        """Complete the fitted ``values``; the carrier's stiffness (N/m) and damping (N s/m) serve static laws only."""
        Fc = values["Fc"]
        return Coefficients(
            Fc=Fc,
            Fs=values.get("Fs", Fc),
            vs=values.get("vs", 0.01),
            sigma0=carrier_stiffness if self.static else values["sigma0"],
            sigma1=carrier_damping if self.static else values.get("sigma1", 0.0),
            sigma2=values["sigma2"],
        )


LAWS: dict[str, FrictionLaw] = {
    law.name: law
    for law in (
        FrictionLaw("lugre", ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2"), static=False),
        FrictionLaw("dahl", ("Fc", "sigma0", "sigma2"), static=False),
        FrictionLaw("stribeck", ("Fc", "Fs", "vs", "sigma2"), static=True),
        FrictionLaw("coulomb", ("Fc", "sigma2"), static=True),
    )
}
"""Friction laws by name."""


def steady_bristle_force(k: Coefficients, v: Expression) -> Expression:
    """``g(v)`` in N: the bristle force in steady sliding, Coulomb level with the Stribeck bump."""
    return k.Fc + (k.Fs - k.Fc) * ca.exp(-((v / k.vs) ** 2))


def bristle_decay(
    k: Coefficients, v: Expression, speed_width: Expression, stribeck_speed: Expression = None
) -> Expression:
    """``sigma0 |v| / g(v)`` in 1/s: how fast the bristle forgets; ``g`` is read at ``stribeck_speed`` where given.

    Exactly zero at rest: with ``|v|`` rounded to 1 um/s a bristle held for a second would lose a hundredth of its force.
    """
    at = v if stribeck_speed is None else stribeck_speed
    return k.sigma0 * slip_speed(v, speed_width) / steady_bristle_force(k, at)


def friction_force(k: Coefficients, z: Expression, z_rate: Expression, v: Expression) -> Expression:
    """Friction force in N against +v from bristle deflection ``z`` (m), its rate and the speed."""
    return k.sigma0 * z + k.sigma1 * z_rate + k.sigma2 * v


def steady_force(k: Coefficients, v: Expression, speed_width: Expression) -> Expression:
    """Steady friction force in N at speed ``v``; Canudas de Wit et al. 1995, eq. (6)."""
    return steady_bristle_force(k, v) * v / absolute(v, speed_width) + k.sigma2 * v
