"""Parameters of the true LuGre friction, constant or affine in the gauge pressures."""

from __future__ import annotations

from dataclasses import dataclass

_BAR = 1e5


@dataclass(frozen=True)
class Friction:
    """LuGre friction, SI. The slopes are all zero unless the rig's friction follows the pressures.

    ``Fc``, ``Fs`` [N], ``vs`` [m/s], ``sigma0`` [N/m], ``sigma1``, ``sigma2`` [N s/m] hold at zero
    gauge; ``*_ps`` are their slopes with the gauge pressure ``p1`` and ``*_dp`` with ``p1 - p2``, per
    Pa. The laws are evaluated with the contract's floors (``vs >= 0.2 mm/s``, ``Fs >= Fc > 0``,
    ``sigma2 >= 0``). ``Fs = Fc`` with ``sigma1 = 0`` is the Dahl law.

    Source: Canudas de Wit et al. 1995; the affine laws: Liu, Chen, Tao 2011, eq. 13 and 14.
    """

    Fc: float = 12.0
    Fs: float = 20.0
    vs: float = 0.008
    sigma0: float = 4.0e5
    sigma1: float = 250.0
    sigma2: float = 45.0
    Fc_ps: float = 0.0
    Fc_dp: float = 0.0
    Fs_ps: float = 0.0
    Fs_dp: float = 0.0
    vs_ps: float = 0.0
    vs_dp: float = 0.0
    sigma2_ps: float = 0.0
    sigma2_dp: float = 0.0

    def __post_init__(self) -> None:
        if not (self.Fs >= self.Fc > 0.0 and self.vs > 0.0 and self.sigma0 > 0.0):
            raise ValueError(f"friction needs Fs >= Fc > 0, vs > 0 and sigma0 > 0, got {self}")
        if self.sigma1 < 0.0 or self.sigma2 < 0.0:
            raise ValueError(f"friction needs sigma1 >= 0 and sigma2 >= 0, got {self}")


FRICTION_2011 = Friction(
    Fc=2.856, Fc_ps=0.772 / _BAR, Fc_dp=-0.5843 / _BAR,
    Fs=3.904, Fs_ps=7.152 / _BAR, Fs_dp=-4.0386 / _BAR,
    vs=2.3892e-3, vs_ps=-0.3782e-3 / _BAR, vs_dp=0.1134e-3 / _BAR,
    sigma0=4.48e5, sigma1=642.0,
    sigma2=18.5, sigma2_ps=103.2 / _BAR, sigma2_dp=-62.7 / _BAR,
)  # fmt: skip
"""The laws of the 2011 study, eq. 15, as the contract reads them."""
