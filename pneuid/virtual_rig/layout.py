"""Where each number sits in the two flat arrays the compiled equations work on.

The state vector is ``float64[STATES]``, the parameter vector ``float64[PARAMETERS]``, all SI and
all pressures absolute. ``packing.pack`` fills the second one; nothing else needs the indices.
"""

from __future__ import annotations

(
    # position, velocity, bristle deflection, chamber pressures, spool command [V], pressure at the valve's supply
    # port, chamber gas temperatures: all that most rigs need
    X, V, Z, P1, P2, SPOOL, PSUP, T1, T2,
    # pressure behind the valve's exhaust ports, warming of the supplied gas [K]
    PEXH, WARMING,
    # tubes from the valve: pressures at the valve and half way, mass flows [kg/s] into both halves
    LINE_A1, LINE_B1, LINE_MA1, LINE_MB1, LINE_A2, LINE_B2, LINE_MA2, LINE_MB2,
    # pressures in side pockets of the dead volumes, in the cushions at the ends and in closed volumes at the ports
    POCKET_1, POCKET_2, CUSHION_1, CUSHION_2, SIDE_1, SIDE_2,
    # a load behind play, the cylinder's body on its bracket: positions and velocities
    LOAD_X, LOAD_V, BODY_X, BODY_V,
    # time at rest [s], dissipated work [J], speed that the lubricating film knows of [m/s]
    REST, WORK, FILM,
    # deflections of the Maxwell elements, plays of the valve's hysteresis as fractions of full scale
    MAXWELL_0, MAXWELL_1, MAXWELL_2, MAXWELL_3, MAXWELL_4, PLAY_0, PLAY_1, PLAY_2,
) = range(40)  # fmt: skip
STATES = PLAY_2 + 1
PLAIN_STATES = T2 + 1
FLOWING_STATES = BODY_V + 1
"""States up to here have rates; those after it are memories with updates of their own."""

(
    # cylinder and load
    AREA_1, AREA_2, STROKE, DEAD_1, DEAD_2, MASS, GRAVITY, STOP_STIFFNESS, STOP_DAMPING,
    # gas and valve
    PATM, TEMPERATURE, POLYTROPIC, GAS_RT, REFERENCE_FLOW, CONDUCTANCE, CRITICAL, PSI_PATCH,
    FULL_SCALE, NULL, CRITICAL_VENT, PSI_PATCH_VENT, PSI_POWER, CRITICAL_SPREAD,
    # friction at zero gauge and its slopes with p1 and with p1 - p2 (gauge, per Pa)
    FC, FS, VS, SIGMA0, SIGMA1, SIGMA2,
    FC_P, FC_D, FS_P, FS_D, VS_P, VS_D, SIGMA2_P, SIGMA2_D,
    # whether any of the states after PLAIN_STATES is alive
    EXTENDED,
    # hidden effects: an amplitude of exactly zero means that the term is not evaluated
    H_PRESSURE, H_DIRECTION, H_POSITION, H_PULL, H_ROLLING, H_LEAK, H_LAP, H_DROOP,
    H_LAG, H_OFFSET, H_ASYMMETRY, H_LEAK_1, H_LEAK_2, H_VISCOUS, H_HEAT, H_SPRING,
    H_HYSTERESIS, H_LINE, H_DWELL, H_WARMUP, H_FILM, H_MAXWELL, H_BACKLASH, H_CUSHION, H_POCKET,
    H_EXHAUST, H_NULL_LEAK, H_COMPLIANCE, H_MIXING, H_FLOW_FORCE, H_SIDE_1, H_SIDE_2, H_CURVE,
    # hidden effects outside the catalogue
    H_COGGING, H_DRAG_CHAIN, H_RELIEF, H_SCORE, H_DETENT, H_SUPPLY_GAIN, H_SUPPLY_HEAT, H_CLAMP, H_LIFT,
    # shapes of the hidden effects
    S_PRESSURE_REF, S_PRESSURE_SAT, S_BUMP_AT, S_BUMP_WIDTH, S_TAPER, S_LEAK_CRITICAL, S_TANK,
    S_LINE_AREA, S_LINE_LENGTH, S_PORT_VOLUME, S_WARMUP_WORK, S_LOAD_MASS, S_BODY_MASS, S_RELIEF_AT, S_PITCH,
    S_SUPPLY_REF, S_CLAMP_AT,
    # the form in which they act, by the names of ``forms.Form``
    F_PRESSURE_POWER, F_PRESSURE_ROD_SHARE, F_DWELL_POWER, F_DWELL_WEAR, F_RUN_IN_STROKES, F_RUN_IN_SLOWER,
    F_RUN_IN_FAST_SHARE, F_FILM_SQUEEZE, F_VISCOUS_POWER, F_MAXWELL_SPREAD, F_SPRING_CENTRE, F_SPRING_HARDENING,
    F_CONTACT_STIFFNESS, F_CONTACT_DAMPING, F_BRACKET_HARDENS_AT, F_BRACKET_DAMPING, F_BODY_MASS, F_CUSHION_RING,
    F_CUSHION_NEEDLE, F_LAP_ROUNDING, F_LAP_SPREAD, F_SLEW, F_PLAY_SPREAD, F_CLEARANCE_FADE, F_CRITICAL_VENT,
    F_WALL_VOLUME, F_WALL_PRESSURE, F_POCKET_SHARE, F_POCKET_ROD_SIDE, F_POCKET_BORE, F_TUBE_AREA, F_TUBE_DRAG,
    F_GALLERY, F_MIXING_FROM, F_MIXING_LEAVING, F_AVERAGES, F_SCAN_X, F_SCAN_P1, F_SCAN_P2,
    F_SPOOL_RETURN, F_JET_EXHAUST, F_PORT_PUSH, F_SIDE_BORE, F_SIDE_EXPONENT, F_HOLE_RADIUS, F_HOLE_VENT,
) = range(23 + 14 + 1 + 16 + 17 + 9 + 17 + 46)  # fmt: skip
PARAMETERS = F_HOLE_VENT + 1
