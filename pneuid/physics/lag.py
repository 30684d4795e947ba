"""Lags that may vanish: regular, with a useful derivative, where their time constants are zero."""

from __future__ import annotations

import casadi as ca

from pneuid.physics.smoothing import Expression


def vanishing_lag(delay: Expression, shortest: float) -> tuple[Expression, Expression]:
    """Weight (0..1) and time constant (s) of a lag whose mean delay is ``delay`` (s), for any ``delay >= 0``.

    With ``y`` following ``value`` by the time constant, ``value - weight (value - y)`` has the transfer function
    ``(1 + (T - delay) s) / (1 + T s)``: exactly ``value`` at ``delay = 0``, late by ``delay`` at low frequency, and the plain
    lag ``1/(1 + delay s)`` once ``delay`` is long against ``shortest`` (s). The plain lag is singular at zero.
    """
    time_constant = ca.sqrt(delay * delay + shortest * shortest)
    return delay / time_constant, time_constant


_STATED_AT, _LEAST = 4.0e5, 2.0e4
"""Absolute pressures in Pa at which a tube's delay is stated, and down to which it grows."""


def delay_through_tube(delay: Expression, p: Expression, power: Expression) -> Expression:
    """Mean delay in s of a sealed sensor at absolute pressure ``p`` (Pa), ``delay`` at 4 bar.

    With ``power`` 0 it is a filter's, the same at all pressures; with 1 that of a thin tube with laminar flow, which fills the
    faster the denser the air is.
    """
    return delay * (_STATED_AT / ca.fmax(p, _LEAST)) ** power


def growth_through_tube(p: Expression, p_rate: Expression, power: Expression) -> Expression:
    """Rate in 1/s at which that delay grows, relative to it, while the pressure changes by ``p_rate`` (Pa/s)."""
    return -power * p_rate / ca.fmax(p, _LEAST)


_SLOWEST = 0.1
"""Least share of its speed that a rate keeps while the delay falls."""

Stage = tuple[Expression, Expression]
"""What a stage of a lag follows, and its time constant in s."""


def two_lags(
    value: Expression, followed: tuple[Expression, Expression], delay: Expression, share: Expression, shortest: float,
    swing: Expression = 0.0,
) -> tuple[Expression, tuple[Stage, Stage]]:  # fmt: skip
    """``value`` behind two lags in a row of mean delay ``delay`` (s), of which the second has the ``share``.

    followed : what the first and the second have followed so far. Returned: what comes out, and what each follows. With a share
    of zero a first-order lag, of a half one of second order with equal roots, near to a spool or a filter of usual damping.
    The first is driven on by ``swing`` (0 to below 1) times the way that the second is behind it: with a share of a half the
    damping is ``sqrt(1 - swing)``, below 1. A delay short against ``shortest`` swings less. The mean delay is ``delay`` within
    1 % for a share of a half and a swing up to a half. It is up to a quarter shorter in the corner of a large swing, a small
    share and a delay near ``shortest``.
    """
    first, T1 = vanishing_lag(delay * (1.0 - share), shortest)
    # the drive shows itself, and is driven by itself, with the weight of the first lag only: what is left of the swing
    second, T2 = vanishing_lag(delay * share / (1.0 - swing * first * first), shortest)
    driven = value + first * swing * (followed[0] - followed[1])
    # by the value and not by what drives it: a lag that does not turn on its own state is carried exactly by the controllers
    between = value - first * (value - followed[0])
    return between - second * (between - followed[1]), ((driven, T1), (between, T2))


def swinging(
    value: Expression, followed: tuple[Expression, Expression], time: Expression, damping: Expression, shortest: float,
    at_once: Expression,
) -> tuple[Expression, tuple[Stage, Stage]]:  # fmt: skip
    """``value`` behind a response of second order, ``1 / (1 + 2 D T s + T^2 s^2)`` with ``time`` T (s) and ``damping`` D.

    followed : the response plus T times its rate, and the response, so far; at_once : ``value`` without what these do to it,
    for the part of a short T that comes out unfollowed. Returned: what comes out, and what each follows.
    Exactly ``value`` at ``time = 0``, regular there; the response itself once T is long against ``shortest`` (s). A T short
    against it is a delay of 2 T, whatever D is.
    """
    weight, T = vanishing_lag(time, shortest)
    driven = value + weight * 2.0 * (1.0 - damping) * (followed[0] - followed[1])
    # by the value and not by what drives it: a lag that does not turn on its own state is carried exactly by the controllers
    between = at_once - weight * (at_once - followed[0])
    # what damps more than two equal lags do holds the first back by its own way
    drive = stiffly((driven, T), followed[0], 2.0 * weight * (damping - 1.0))
    return between - weight * (between - followed[1]), (drive, (between, T))


def stiffly(stage: Stage, followed: Expression, slope: Expression) -> Stage:
    """The same stage for an integrator that holds what is followed for a step: what is followed falls by ``slope`` (1 or more
    makes it stiff) per unit that has been ``followed``, and is taken to go on doing so within the step."""
    target, T = stage
    slope = ca.fmax(slope, 0.0)
    return (target + slope * followed) / (1.0 + slope), T / (1.0 + slope)


def further_lag(value: Expression, followed: Expression, delay: Expression, shortest: float) -> tuple[Expression, Stage]:
    """``value`` behind one lag of mean delay ``delay`` (s) that has ``followed`` so far: what comes out, and what it follows.

    After `two_lags` with a swing it makes a filter of third order: of Butterworth's kind with a half of the whole delay.
    """
    weight, T = vanishing_lag(delay, shortest)
    return value - weight * (value - followed), (value, T)


def behind_two_lags(
    value: Expression, value_rate: Expression, rates: tuple[Expression, Expression], delay: Expression, share: Expression,
    shortest: float, swing: Expression = 0.0, growth: Expression = 0.0,
) -> tuple[Expression, tuple[Stage, Stage]]:
    """`two_lags` by the filtered ``rates`` (1/s) of ``value`` and of what the first lag shows, which are zero at rest.

    growth : rate (1/s) at which the delay grows, relative to it: ``T r = value - y`` then moves by ``T'`` as well.
    Returned: what comes out, late by ``delay`` whatever the others are, and what each rate follows.
    """  # fmt: skip
    first, second = delay * (1.0 - share), delay * share
    weight, T1 = vanishing_lag(first, shortest)
    slower, T2 = vanishing_lag(second / (1.0 - swing * weight * weight), shortest)
    driven_rate = value_rate + weight * swing * (rates[0] - rates[1])
    between_rate = value_rate - weight * (value_rate - rates[0])
    drive = _growing((driven_rate, T1), weight * weight * growth)
    last = _growing((between_rate, T2), slower * slower * growth)
    return value - first * rates[0] - second * rates[1], (drive, last)


def _growing(stage: Stage, growth: Expression) -> Stage:
    """What a rate follows behind a lag whose time constant grows by ``growth`` (1/s), relative to it."""
    target, T = stage
    faster = ca.fmax(1.0 + T * growth, _SLOWEST)
    return target / faster, T / faster
