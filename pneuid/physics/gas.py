"""Air as an ideal gas and its reference state."""

from __future__ import annotations

R_AIR = 287.05
"""Specific gas constant of dry air, J/(kg K)."""

GAMMA_AIR = 1.4
"""Ratio of the specific heats of air, that of a diatomic ideal gas."""

CV_AIR = R_AIR / (GAMMA_AIR - 1.0)
"""Specific heat of air at constant volume, J/(kg K)."""

T_REFERENCE = 293.15
"""Reference temperature of the sonic conductance, K (ISO 6358-1, clause 3)."""

RHO_REFERENCE = 1.185
"""Density of air at the reference state, kg/m^3 (ISO 6358-1, clause 3: 100 kPa, 293.15 K, 65 % humidity)."""
