"""Break-away force that grows with the time at rest."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import absolute
from pneuid.rig import Rig

_SOURCE = (
    "Kato, Sato, Matsubayashi, ASME J. Lubrication Technology 94 (1972) 234 (exponential rise of static friction "
    "with dwell); Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083 (seven-parameter model)"
)
_SLIP = "Ruina, J. Geophysical Research 88 (1983) 10359 (renewal of contacts over a slip distance)"


class FrictionDwell(Effect):
    """``Fs + dFs a`` with the age ``a`` of the contacts, 0..1: ``da/dt = (1 - a)/tau - |v| a/D``.

    At rest ``a = 1 - exp(-t/tau)``; sliding over a few ``D`` wipes it out. Typical: dFs 10 to 100 % of Fs, tau 0.1 s to
    hours, D 10 to 500 um for elastomer seals.
    """

    name = "friction_dwell"
    mechanism = (
        "at rest the seal creeps into the wall and the oil film is squeezed out, so break-away force grows with time"
    )
    equation = "friction"
    reference = _SOURCE
    experiment = "break-away by slow ramps after dwells of different length"
    confused_with = ("friction_lag", "friction_warmup")
    guarantees = ("dissipative",)
    states = (State("age", "1", 0.5, 0.5, 0.05),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Rise of the static friction after a long rest, its time constant, the slip that wipes it out."""
        force = max(2.0, 0.01 * rig.A1 * 1e6)
        return (
            Parameter("Fs_dwell", "ΔF_s", "N", 0.0, 5.0 * force, 0.0, force, _SOURCE, off=0.0),
            Parameter("tau_dwell", "τ_d", "s", 1e-2, 1e4, 0.5, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("slip_dwell", "D", "m", 5e-6, 5e-3, 1e-4, 1.0, _SLIP, positive=True, prior=1.0),
        )

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Raise the static level by the age, which a solver's trial point may take beyond 0..1."""
        return replace(k, Fs=k.Fs + scope.p.Fs_dwell * ca.fmin(ca.fmax(scope.state.age, 0.0), 1.0))

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Ageing at rest, renewal by slip; the slip's speed is exactly zero at rest, however wide its rounding."""
        slip = scope.v * scope.v / absolute(scope.v, scope.smoothing.speed)
        renewed = 1.0 + scope.p.tau_dwell * slip / scope.p.slip_dwell
        return {"age": (1.0 / renewed, scope.p.tau_dwell / renewed)}
