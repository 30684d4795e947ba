"""Break-away force that grows with the time at rest."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import slip_speed
from pneuid.rig import Rig

_SOURCE = (
    "Kato, Sato, Matsubayashi, ASME J. Lubrication Technology 94 (1972) 234 (exponential of a power of the time of "
    "stationary contact); Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083 (seven-parameter model)"
)
_SLIP = "Ruina, J. Geophysical Research 88 (1983) 10359 (renewal of contacts over a slip distance)"

_FORGETTING = 1.0e-4
"""Decay in 1/s of the age at rest, so that its time constant stays finite."""

_CREEP = {"servo": 2e-4, "bench": 5e-3}
"""Where a fit of the speed v_c starts, in m/s. A bench tells a clock that stops with the first slip (0.1 mm/s) from contacts
that age whatever they do (1 m/s), and finds either from between them: where they do, a clock left 3.5 floors, this 1.2. A servo
rig shows little of slow sliding; on one a clock was not found from 5 mm/s (66 % explained), but from 0.2 (93 %)."""

_SHORTEST = 1e-3
"""Time at rest in s below which the growth is linear: a power less than one would set out infinitely steep."""

_UNKNOWN_SIZE = 1e2
"""Largest rise over the typical one of a bench that states no bore, and so nothing of its size: a rise of 30 N of a static
friction of 50 N was held at 10."""


class FrictionDwell(Effect):
    """``Fs + dFs (1 - exp(-(a/tau)^m))`` with the age ``a`` of the contacts in s: ``da/dt = 1/(1 + (v/v_c)^2) - |v| a/D``.

    At rest the age is the time at rest, sliding over a few ``D`` wipes it out, but in no less than a few ``T_w``: the last term
    is ``|v| a / (D + |v| T_w)``. Above ``v_c`` nothing ages; a ``v_c`` far above the Stribeck velocity is the ageing law of
    rate-and-state friction, ``da/dt = 1 - |v| a/D``, by which contacts that slide are as old as ``D/|v|`` and friction rises as
    the piston slows down.
    Typical: dFs 10 to 100 % of Fs, tau 0.1 s to hours, m 0.3 to 0.7, D 10 to 500 um for elastomer seals, v_c above 0.1 mm/s,
    T_w some ms.
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
    states = (State("age", "s", 0.2, 1.0, 0.1),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Rise of the static friction after a long rest, its time constant and power, the slip that wipes it out, the speed
        from which contacts do not age, and the shortest time in which it is wiped out."""
        force = max(2.0, 0.01 * rig.A1 * 1e6)
        # a growth by the logarithm of the time reached ten times the typical rise on a bench, and was held at five
        largest = (20.0 if rig.A1 > 0.0 else _UNKNOWN_SIZE) * force
        return (
            Parameter("Fs_dwell", "ΔF_s", "N", 0.0, largest, 0.0, force, _SOURCE, off=0.0),
            Parameter("tau_dwell", "τ_d", "s", 1e-2, 1e4, 0.5, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("m_dwell", "m", "1", 0.2, 1.5, 0.6, 0.3, _SOURCE, positive=True, prior=0.4),
            Parameter("slip_dwell", "D", "m", 5e-6, 5e-3, 1e-4, 1.0, _SLIP, positive=True, prior=1.0),
            Parameter("creep_dwell", "v_c", "m/s", 2e-5, 1.0, _CREEP[rig.kind], 1.0, _SLIP, positive=True, prior=2.5),
            Parameter("wipe_dwell", "T_w", "s", 0.0, 0.2, 1e-3, 5e-3, _SLIP, prior=1e-2),
        )

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Raise the static level by the age, which a solver's trial point may take below zero."""
        m, age = scope.p.m_dwell, ca.fmax(scope.state.age, 0.0)
        risen = ((age + _SHORTEST) ** m - _SHORTEST**m) / scope.p.tau_dwell**m
        return replace(k, Fs=k.Fs + scope.p.Fs_dwell * (1.0 - ca.exp(-risen)))

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Ageing at rest, renewal by slip; the slip's speed is exactly zero at rest, however wide its rounding."""
        slip = slip_speed(scope.v, scope.smoothing.speed)
        lasting = 1.0 / (slip / (scope.p.slip_dwell + slip * scope.p.wipe_dwell) + _FORGETTING)
        return {"age": (lasting / (1.0 + (scope.v / scope.p.creep_dwell) ** 2), lasting)}
