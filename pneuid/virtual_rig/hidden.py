"""What a rig has beyond its base model, in forms unlike those of the estimator's catalogue.

Each effect has one amplitude; zero means exactly absent. The other fields are shapes, which do
nothing while their amplitude is zero, and ``form`` has the constants of the equations. Names are
those of the catalogue, but for the effects that it does not hold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace

from pneuid.virtual_rig.forms import Form

_NOT_NEGATIVE = (
    "load_mass", "leakage_internal", "valve_dead_zone", "supply_droop", "valve_lag", "leakage_external_1",
    "leakage_external_2", "heat_transfer", "load_spring", "valve_hysteresis", "valve_null_leakage", "exhaust_restriction",
    "dead_volume", "line_delay", "inlet_mixing", "friction_dwell", "friction_warmup", "friction_lag",
    "friction_presliding_memory", "backlash", "end_cushion", "mounting_compliance", "sensor_lag_p1", "sensor_lag_p2",
    "sensor_lag_F", "channel_skew", "valve_flow_force", "side_volume_1", "side_volume_2", "rod_seal_clamp", "relief_leak",
    "scored_bore", "lifting_lips",
)  # fmt: skip


@dataclass(frozen=True)
class Hidden:
    """Amplitudes and shapes of hidden effects; all amplitudes default to absent.

    friction_pressure
        Relative growth of seal friction with chamber pressure, neutral at ``pressure_reference``
        [Pa gauge] in both chambers. Cap side to the power 0.85, rod side saturating (tanh over
        ``pressure_saturation`` [Pa]); Fs grows more than Fc, vs falls, sigma2 grows half as much.
    friction_direction
        Relative asymmetry of the whole friction force, read from the bristle and not from v.
    friction_position
        Relative height of a Gaussian patch at ``bump_at`` of ``bump_width`` (fractions of the stroke),
        a smaller dip behind it and a slight taper.
    gravity
        Total constant load against extension [N]: ``gravity_incline_share`` of it by inclining the
        rig, the rest by a spring balancer that pulls, within 3 %, with constant force.
    load_mass
        Payload [kg] on rollers, which adds ``rolling_coefficient`` of its weight to Fc and Fs.
    leakage_internal, leakage_external_1, leakage_external_2
        Sonic conductance of a sharp-edged leak (ISO 6358, ``leak_critical_ratio``) as a fraction of the valve's.
    valve_dead_zone
        Overlap as a fraction of full scale; the four edges differ by up to 10 % and open quadratically.
    supply_droop
        Valve conductance over that of the restriction between the regulator and a ``supply_tank``
        [m^3] in front of the valve; the regulator does not relieve.
    valve_lag
        Spool time constant [s], with a slew limit of half the full scale per time constant; its return spring helps one way.
    valve_offset
        Spool shift as a fraction of full scale.
    valve_asymmetry
        Relative surplus of the opening towards chamber 1, and lack towards chamber 2.
    friction_viscous_nonlinear
        Relative increase of sigma2 at 0.5 m/s, growing with the root of the speed.
    heat_transfer
        Wall conductance [W/K] at mid-stroke and 4 bar; replaces the polytropic chambers by energy
        balances with gas temperatures (gamma 1.4), the wall growing with the chamber.
    load_spring
        Stiffness [N/m] of a slightly hardening spring centred at mid-stroke.
    sensor_offset_p1, sensor_offset_p2
        Added to the recorded pressure [Pa]; ``sensor_offset_F`` [N] to the recorded force.
    valve_hysteresis
        Half width of the spool's hysteresis as a fraction of full scale: three plays in parallel (Prandtl-Ishlinskii).
    valve_critical_ratio
        By how much the filling edges' b exceeds the declared one; venting edges by 0.8 of it, and the subsonic curve is
        no quarter ellipse but has a larger exponent (ISO 6358-3's m). A quarter of it more at a closed edge, as much less
        at an open one.
    valve_null_leakage
        Opening of every edge at the null by the spool's clearance, as a fraction of full scale.
    exhaust_restriction
        Valve conductance over that of the silencer on a small gallery that both exhaust ports share.
    dead_volume
        What the volumes have beyond the declared ones, relative to them; rod side 0.8 of it; a third of it is a side
        pocket behind a bore.
    line_delay
        Length [m] of both tubes (4 mm wide at the default valve): two cells with the gas' inertia and turbulent friction.
        The tube is part of the declared dead volume as far as that reaches.
    inlet_mixing
        By how much the exponent of entering gas exceeds n at large flow, and that of leaving gas falls below it;
        polytropic chambers only.
    friction_dwell
        Relative growth of Fs - Fc in the first second at rest, with the power 0.4 of the time, up to three times that; worn
        off by 0.2 mm of sliding.
    friction_warmup
        Relative fall of friction with the dissipated work: a fast and a slow exponential.
    friction_lag
        Time constant [s] with which the film behind the Stribeck curve builds up; squeezing it out takes 2.5 times longer.
    friction_presliding_memory
        Share of the bristle's force that five Maxwell elements of different yield carry instead.
    backlash
        Play [m] between the rod and ``backlash_load_share`` of the moving mass, with an elastic, damped contact.
    end_cushion
        Length of the end cushions over the stroke: a ring of 0.8 of the piston's area with a needle and a check valve.
    mounting_compliance
        Of the cylinder's bracket [m/N], hardening; the body has a mass of its own and x is read on the machine.
    sensor_lag_p1, sensor_lag_p2, sensor_lag_F
        Mean age [s] of what two running averages in a row record.
    channel_skew
        Duration [s] of a logger's scan: x, p1, p2 are read in turn before the time stamp, u at it.
    valve_flow_force
        By how much the jets of two choked edges, 5 bar absolute before each, close a spool without position control: momentum
        of the expanding gas. The ports' pressures push it by a share of that.
    valve_curve
        Share of the ports' area that is round holes, which the spool opens from their edge, or with a negative share from their
        middle; the rest is slots.
    side_volume_1, side_volume_2
        A closed volume at the chamber's port over its declared dead volume, behind a sharp-edged orifice, in which the gas
        changes its state with an exponent of its own.

    Outside the catalogue:

    cogging
        Force [N] periodic in x, ``cogging_pitch`` of the stroke apart, with flat flanks.
    drag_chain
        Force against extension [N s/m] growing with the speed times the distance from mid-stroke in strokes.
    magnetic_detent
        Largest pull [N] of a magnet towards mid-stroke, felt over a few hundredths of the stroke.
    rod_seal_clamp
        Friction [N/Pa] by chamber 2's pressure beyond ``clamp_at`` [Pa gauge].
    relief_leak
        Leak of chamber 1 over the valve's conductance that opens above ``relief_at`` [Pa gauge].
    scored_bore
        Leak across the piston over the valve's conductance, between 0.55 and 0.68 of the stroke only.
    lifting_lips
        The same of seal lips that the speed lifts off the bore, half way at 0.15 m/s.
    valve_supply_gain
        Relative growth of the valve's conductance with the supply's gauge pressure over ``supply_reference`` [Pa gauge].
    supply_heating
        Warming [K] of the supplied gas under sustained flow, within three seconds.
    sensor_gain_drift
        Relative gain by which the recorded gauge p1 drifts within some four seconds.
    encoder_bow
        Amplitude [m] of an error of the recorded x that is periodic in x, three waves per stroke.
    solenoid_crosstalk
        Pressure [Pa] that the valve's current adds to the recorded p2 over a common ground wire, at large commands.
    """

    friction_pressure: float = 0.0
    friction_direction: float = 0.0
    friction_position: float = 0.0
    gravity: float = 0.0
    load_mass: float = 0.0
    leakage_internal: float = 0.0
    valve_dead_zone: float = 0.0
    supply_droop: float = 0.0
    valve_lag: float = 0.0
    valve_offset: float = 0.0
    valve_asymmetry: float = 0.0
    leakage_external_1: float = 0.0
    leakage_external_2: float = 0.0
    friction_viscous_nonlinear: float = 0.0
    heat_transfer: float = 0.0
    load_spring: float = 0.0
    sensor_offset_p1: float = 0.0
    sensor_offset_p2: float = 0.0
    sensor_offset_F: float = 0.0
    valve_hysteresis: float = 0.0
    valve_critical_ratio: float = 0.0
    valve_null_leakage: float = 0.0
    exhaust_restriction: float = 0.0
    dead_volume: float = 0.0
    line_delay: float = 0.0
    inlet_mixing: float = 0.0
    friction_dwell: float = 0.0
    friction_warmup: float = 0.0
    friction_lag: float = 0.0
    friction_presliding_memory: float = 0.0
    backlash: float = 0.0
    end_cushion: float = 0.0
    mounting_compliance: float = 0.0
    sensor_lag_p1: float = 0.0
    sensor_lag_p2: float = 0.0
    sensor_lag_F: float = 0.0
    channel_skew: float = 0.0
    valve_flow_force: float = 0.0
    valve_curve: float = 0.0
    side_volume_1: float = 0.0
    side_volume_2: float = 0.0
    cogging: float = 0.0
    drag_chain: float = 0.0
    magnetic_detent: float = 0.0
    rod_seal_clamp: float = 0.0
    relief_leak: float = 0.0
    scored_bore: float = 0.0
    lifting_lips: float = 0.0
    valve_supply_gain: float = 0.0
    supply_heating: float = 0.0
    sensor_gain_drift: float = 0.0
    encoder_bow: float = 0.0
    solenoid_crosstalk: float = 0.0

    pressure_reference: float = 3.0e5
    pressure_saturation: float = 6.0e5
    bump_at: float = 0.42
    bump_width: float = 0.07
    taper: float = 0.3
    gravity_incline_share: float = 0.6
    rolling_coefficient: float = 0.008
    leak_critical_ratio: float = 0.25
    supply_tank: float = 0.4e-3
    backlash_load_share: float = 0.8
    cogging_pitch: float = 0.05
    relief_at: float = 3.0e5
    clamp_at: float = 2.5e5
    supply_reference: float = 5.0e5
    form: Form = field(default_factory=Form)

    def __post_init__(self) -> None:
        for name in _NOT_NEGATIVE:
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if max(self.friction_presliding_memory, self.friction_warmup) > 1.0 or self.end_cushion > 0.3:
            raise ValueError(f"shares and the cushions' part of the stroke are too large: {self}")
        for item in fields(self):
            if item.name != "form" and not math.isfinite(getattr(self, item.name)):
                raise ValueError(f"{item.name} must be finite, got {getattr(self, item.name)}")

    def also(self, other: Hidden) -> Hidden:
        """Both sets of effects at once: the amplitudes and shapes in which ``other`` differs from absent win."""
        nothing = Hidden()
        changed = {
            item.name: getattr(other, item.name)
            for item in fields(other)
            if getattr(other, item.name) != getattr(nothing, item.name)
        }
        return replace(self, **changed)


NOTHING = Hidden()
"""A rig that is exactly its base model."""
