"""Where each number sits in the two flat arrays the compiled equations work on.

The state vector is ``float64[STATES]``, the parameter vector ``float64[PARAMETERS]``, all SI and
all pressures absolute. ``packing.pack`` fills the second one; nothing else needs the indices.
"""

from __future__ import annotations

# State: position, velocity, bristle deflection, chamber pressures, spool command [V],
# pressure at the valve's supply port, chamber gas temperatures.
X, V, Z, P1, P2, SPOOL, PSUP, T1, T2 = range(9)
STATES = 9

(
    # cylinder and load
    AREA_1, AREA_2, STROKE, DEAD_1, DEAD_2, MASS, GRAVITY, STOP_STIFFNESS, STOP_DAMPING,
    # gas and valve
    PATM, TEMPERATURE, POLYTROPIC, GAS_RT, REFERENCE_FLOW, CONDUCTANCE, CRITICAL, PSI_PATCH,
    FULL_SCALE, NULL,
    # friction at zero gauge and its slopes with p1 and with p1 - p2 (gauge, per Pa)
    FC, FS, VS, SIGMA0, SIGMA1, SIGMA2,
    FC_P, FC_D, FS_P, FS_D, VS_P, VS_D, SIGMA2_P, SIGMA2_D,
    # hidden effects: an amplitude of exactly zero means that the term is not evaluated
    H_PRESSURE, H_DIRECTION, H_POSITION, H_PULL, H_ROLLING, H_LEAK, H_LAP, H_DROOP,
    H_LAG, H_OFFSET, H_ASYMMETRY, H_LEAK_1, H_LEAK_2, H_VISCOUS, H_HEAT, H_SPRING,
    # their shapes
    S_PRESSURE_REF, S_PRESSURE_SAT, S_BUMP_AT, S_BUMP_WIDTH, S_TAPER, S_LEAK_CRITICAL, S_TANK,
) = range(33 + 16 + 7)  # fmt: skip
PARAMETERS = S_TANK + 1
