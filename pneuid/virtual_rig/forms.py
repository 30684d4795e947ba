"""The form in which hidden effects act: constants of their equations, and the range in which a case may draw them.

None of them does anything while its effect is absent. The usual form is the one of the presets; drawn ones keep the
diagnosis from being good at one form alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np


def _shape(usual: float, low: float, high: float) -> float:
    """A constant with its usual value and the range to draw from."""
    return field(default=usual, metadata={"range": (low, high)})


@dataclass(frozen=True)
class Form:
    """Constants of the hidden effects' equations.

    pressure_power, pressure_rod_share
        Power of the cap side's pressure in ``friction_pressure``, and the rod side's share of the growth of Fc.
    dwell_power, dwell_wear
        Power of the time at rest in ``friction_dwell``, and the sliding distance [m] that wears the growth down by e.
    run_in_strokes, run_in_slower, run_in_fast_share
        Work of the fast part of ``friction_warmup`` in strokes at Fc, how many times as much the slow part takes, and the share
        of the fast part.
    film_squeeze
        How much longer than to be drawn in a film takes to be squeezed out (``friction_lag``).
    viscous_power
        Power of the speed with which sigma2 grows in ``friction_viscous_nonlinear``.
    maxwell_spread
        Exponent that spreads the elements' yields (``friction_presliding_memory``).
    spring_centre, spring_hardening
        Where a ``load_spring`` is slack, as a fraction of the stroke, and how it hardens with the square of the way in strokes.
    contact_stiffness, contact_damping
        Stiffness [N/m] and damping ratio of the flanks that a load behind play strikes.
    bracket_hardens_at, bracket_damping, body_mass
        Deflection [m] at which a bracket is twice as stiff, its damping ratio, and the cylinder's mass [kg] at 32 mm bore.
    cushion_ring, cushion_needle
        Share of the piston's area that an ``end_cushion`` shuts off, and the needle's conductance over the valve's.
    lap_rounding, lap_spread
        Over which part of the overlap an edge opens (``valve_dead_zone``), and how far the four edges differ, 1 for up to 10 %.
    slew
        Full scales per time constant at which a spool with ``valve_lag`` moves at most.
    spool_return
        How many times as fast the spool moves with its return spring as against it (``valve_lag``).
    jet_exhaust, port_push
        Force of an exhausting jet over that of one from the supply, and share of ``valve_flow_force`` by which 4 bar between
        the ports shift the spool.
    play_spread
        How far the widths of the three plays of ``valve_hysteresis`` differ, 0 for one play.
    clearance_fade
        Over how many clearances of cover the leak of ``valve_null_leakage`` fades.
    critical_vent
        Share of ``valve_critical_ratio`` at the venting edges.
    wall_volume, wall_pressure
        Share of the wall's conductance that grows with the volume (``heat_transfer``), and the power with which it grows with
        the pressure.
    hole_radius, hole_vent
        Radius over full scale of the round holes of ``valve_curve``, and the venting edges' share of them over that of the
        filling ones.
    side_bore, side_exponent
        Conductance before a ``side_volume_1`` or ``_2`` over the valve's, and the exponent of the gas in it.
    pocket_share, pocket_rod_side, pocket_bore
        Share of ``dead_volume`` behind a bore, how much of it the rod side has, and the bore's conductance over the valve's.
    tube_area, tube_drag
        Cross-section of the tubes over the usual one (``line_delay``), and their Darcy friction factor.
    gallery
        Volume behind the exhaust ports in volumes of a port (``exhaust_restriction``).
    mixing_from, mixing_leaving
        Inflow over the choked one above which ``inlet_mixing`` is complete, and its share at leaving gas.
    averages
        How many running averages a sensor with a lag takes in a row; with more of them its response is nearer to a bell.
    scan_x, scan_p1, scan_p2
        Age of a reading over the scan's duration (``channel_skew``).
    """

    pressure_power: float = _shape(0.85, 0.6, 1.3)
    pressure_rod_share: float = _shape(0.4, 0.1, 0.6)
    dwell_power: float = _shape(0.4, 0.2, 0.7)
    dwell_wear: float = _shape(2e-4, 0.7e-4, 6e-4)
    run_in_strokes: float = _shape(2.0, 1.0, 6.0)
    run_in_slower: float = _shape(12.0, 4.0, 30.0)
    run_in_fast_share: float = _shape(0.6, 0.3, 1.0)
    film_squeeze: float = _shape(2.5, 1.0, 4.0)
    viscous_power: float = _shape(0.5, 0.3, 1.3)
    maxwell_spread: float = _shape(1.0, 0.6, 1.15)
    spring_centre: float = _shape(0.5, 0.3, 0.7)
    spring_hardening: float = _shape(1.0, -0.8, 3.0)
    contact_stiffness: float = _shape(5e5, 1.5e5, 1e6)
    contact_damping: float = _shape(0.3, 0.1, 0.6)
    bracket_hardens_at: float = _shape(0.5e-3, 0.3e-3, 2e-3)
    bracket_damping: float = _shape(0.05, 0.02, 0.15)
    body_mass: float = _shape(1.2, 0.6, 2.4)
    cushion_ring: float = _shape(0.8, 0.6, 0.9)
    cushion_needle: float = _shape(0.03, 0.015, 0.06)
    lap_rounding: float = _shape(0.6, 0.15, 0.9)
    lap_spread: float = _shape(1.0, 0.0, 2.0)
    slew: float = _shape(0.5, 0.3, 3.0)
    play_spread: float = _shape(1.0, 0.0, 1.2)
    clearance_fade: float = _shape(1.0, 0.5, 2.0)
    critical_vent: float = _shape(0.8, 0.4, 1.2)
    wall_volume: float = _shape(0.6, 0.2, 0.9)
    wall_pressure: float = _shape(0.6, 0.3, 1.0)
    pocket_share: float = _shape(1.0 / 3.0, 0.1, 0.6)
    pocket_rod_side: float = _shape(0.8, 0.5, 1.4)
    pocket_bore: float = _shape(0.25, 0.1, 0.6)
    tube_area: float = _shape(1.0, 0.6, 1.8)
    tube_drag: float = _shape(0.03, 0.02, 0.05)
    gallery: float = _shape(2.0, 1.0, 10.0)
    mixing_from: float = _shape(0.15, 0.07, 0.4)
    mixing_leaving: float = _shape(1.0, 0.3, 1.0)
    averages: float = _shape(2.0, 1.0, 4.0)
    scan_x: float = _shape(1.0, 0.4, 1.0)
    scan_p1: float = _shape(2.0 / 3.0, 0.4, 1.0)
    scan_p2: float = _shape(1.0 / 3.0, 0.2, 1.0)
    spool_return: float = _shape(1.3, 1.0, 1.7)
    jet_exhaust: float = _shape(0.8, 0.5, 1.3)
    port_push: float = _shape(0.1, -0.15, 0.15)
    side_bore: float = _shape(0.02, 0.008, 0.05)
    side_exponent: float = _shape(1.15, 1.0, 1.35)
    hole_radius: float = _shape(1.2, 1.0, 1.5)
    hole_vent: float = _shape(0.85, 0.7, 1.3)

    def __post_init__(self) -> None:
        for item in fields(self):
            if not math.isfinite(getattr(self, item.name)):
                raise ValueError(f"{item.name} must be finite, got {getattr(self, item.name)}")


def drawn_form(rng: np.random.Generator) -> Form:
    """Every constant drawn from its range, evenly or, where the range spans a factor of two and more, by its logarithm."""
    values = {}
    for item in fields(Form):
        low, high = item.metadata["range"]
        spread = low > 0.0 and high >= 2.0 * low
        values[item.name] = float(np.exp(rng.uniform(np.log(low), np.log(high))) if spread else rng.uniform(low, high))
    return Form(**values)
