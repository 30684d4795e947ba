"""The search for an unknown function: which signal, in which equation, would explain what a fit leaves of its runs.

Every equation, signal and sensible pair is screened as a spline in one pass (``probes``); the leading ones are fitted
jointly with the parameters, because the relaxed fit alone shows the right shape at a fraction of its size; the held-out runs
choose among them. The shape is then distilled into a short formula where one fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pneuid.ahead import Ahead
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import predict, rmse
from pneuid.criticism.prediction.uncovered import outside
from pneuid.criticism.refitting.restarts import Say
from pneuid.criticism.unknown.distil import Distilled, distilled
from pneuid.criticism.unknown.probes import Joint, Probed, Probing, weights
from pneuid.effects._spline import KNOTS, Term, curve_columns, spline
from pneuid.estimation.curves import POINTS, Curve, known_ranges, visited
from pneuid.estimation.fit import Fit, comparable_costs
from pneuid.estimation.fit import fit as estimate
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording

BENCH_TERMS = (
    "force(x)", "force(x*v)", "force(x*p1)", "force(x*p2)", "force(p1)", "force(p2)", "force(dp)",
    "friction(v)", "friction(x)", "friction(p1)", "friction(p2)", "friction(dp)", "force(t)", "friction(t)",
)  # fmt: skip
SERVO_TERMS = (
    *BENCH_TERMS,
    "flow_1(p1)", "flow_1(p2)", "flow_1(dp)", "flow_1(x)", "flow_1(x*dp)", "flow_1(v)", "flow_1(v*dp)", "flow_1(u)",
    "flow_2(p1)", "flow_2(p2)", "flow_2(dp)", "flow_2(x)", "flow_2(x*dp)", "flow_2(v)", "flow_2(v*dp)", "flow_2(u)",
    "flow_1(psup-p1)", "flow_1(x*v)", "flow_2(psup-p2)", "flow_2(x*v)",
    "valve(u)", "valve(dp)", "valve(psup)", "valve(x)", "valve(p1)", "valve(p2)", "valve(t)",
    "sensor_x(x)", "sensor_x(v)", "sensor_x(u)", "sensor_x(t)",
    "sensor_p1(p1)", "sensor_p1(x)", "sensor_p1(v)", "sensor_p1(u)", "sensor_p1(t)",
    "sensor_p2(p2)", "sensor_p2(x)", "sensor_p2(v)", "sensor_p2(u)", "sensor_p2(t)",
)  # fmt: skip
"""What is screened: equations, signals and sensible pairs.

Not the load cell over the force that it shows: the noise of measured pressures is in the model's force as well, and vanishes
where a function of it falls by one newton per newton about the level of every run, beside a friction that is scaled up. Of
three runs that hid nothing it promised a fall of the cost by 2760.
"""

FINER = {"x": (24, 60), "v": (24,)}
"""Numbers of splines tried besides the usual one by signal: magnets, teeth and scales repeat themselves over the stroke, and a
seal that chatters does so in a band of speeds."""

WORTH_KNOTS, WORTH_REST = 1.2, 0.5
"""Factor by which a finer spline, a second term, or a pressure as a factor must raise the predicted drop, or the share to which
a finer spline and a pressure must bring down the cost that would be left: of a chatter at some speeds the usual spline left
19 %, a finer one 7.5 %, and no drop can be 1.2 times 81 %."""

LEAKS = (("x", "dp"), ("v", "dp"), ("dp", ""), ("x", ""))
"""Signals and factors of what acts on both chambers, so that both flows are tried as one: a leak across the piston, by which
one chamber gains what the other loses, at a place or as the speed lifts its lips, and a hole in the bore, to which the piston
opens one chamber after the other."""

PRESSURES = ("p1", "p2")
"""Factors of a force that a pressure stiffens, such as that of a hose: gauge pressures."""

LEADERS, OF_ONE = 6, 3
"""Terms, or leaks, that are fitted with the parameters and judged on the held-out runs: in all, and of one equation."""

NEAR = 0.6
"""Share of the leading predicted drop below which another is not fitted. The leader may be what a wrong parameter makes of the
training runs: of a leak at a place over the stroke a valve over the supply took 31 % of the cost and made the held-out error
eight times as large, the leak took 33 %. Below that share chance chooses: a force over p2 in place of a drag chain's."""

FARTHER, FAR_OFF = 0.3, 9.0
"""The same share where the held-out runs bear none of those out and leave that error, in squared floors: of an encoder that is
wrong over x a force over it took 12 % of the cost and made the held-out error four times as large, the encoder 6 % and half of
the excess."""

ALIKE = 0.8
"""Share of the held-out excess that the best term explains which another must explain to be said to explain as much."""

SECONDS = 2
"""Leading terms of every other equation that are tried as a second one: a leak moves both chambers, and its other half may rank
low before the first is in."""

LEAST_EXPLAINED = 0.25
"""Share of the held-out excess that a term must remove to be named."""

LEAST_EXCESS = 1e-3
"""Excess of the squared held-out error, in squared floors, below which nothing is left that a term could remove."""

TIED = 0.03
"""Share of the drop of the cost within which two terms explain the data alike."""

Ranked = tuple[float, tuple[Term, ...]]
"""Predicted drop of the relaxed cost by a term, or by the two halves of a leak across the piston."""


@dataclass(frozen=True)
class Found:
    """Unknown terms that explain a rest of ``fit``: joint fit, held-out error (1 = noise only) before and after, the first
    one's shape.

    errors : held-out errors per signal before and after, SI; refit : whether the model was fitted with its terms already.
    """

    fit: Fit
    joint: Joint
    before: float
    after: float
    curve: Curve
    rms: float
    formula: Distilled | None
    ties: tuple[Term, ...]
    """Other terms that explain the data about as well."""
    beyond: float
    """Share of the held-out samples at which the first one's signal is outside its range in the training runs."""
    gain: float
    """By how much the relaxed cost of the training runs falls."""
    errors: tuple[Mapping[str, float], Mapping[str, float]]
    refit: bool = False

    def by(self, floor: Mapping[str, float]) -> Found:
        """The same by other noise floors per signal, SI."""
        before, after = (_in_floors(found, floor) for found in self.errors)
        return replace(self, before=before, after=after)

    @property
    def explained(self) -> float:
        """Share of the held-out excess that is removed, 0 where there is none."""
        excess = self.before - 1.0
        return (self.before - self.after) / excess if excess > LEAST_EXCESS else 0.0

    @property
    def explains(self) -> bool:
        """Whether the held-out runs bear it out."""
        return bool(np.isfinite(self.after)) and self.explained > LEAST_EXPLAINED


def search(fit: Fit, hold_out: Sequence[Recording], floor: Mapping[str, float], say: Say = lambda _: None) -> Found:
    """The unknown function that follows best what ``fit`` leaves of its runs, judged on held-out ones.

    floor : noise floor per signal, SI, by which errors are measured.
    """
    say("screening unknown functions of every signal in every equation")
    probing = Probing(fit)
    ranked = ranking(probing)
    shown = ", ".join(f"{_named(terms)} {100 * drop / probing.start_cost:.1f} %" for drop, terms in ranked[:3])
    say(f"predicted drops of the cost: {shown}")

    def error(joint: Joint | None) -> float:
        return _in_floors(_held_out(fit, joint, hold_out), floor)

    # by parameters with jumps, as those of the joint fits are: simulated ones would seem better than any of these
    standing = fit if fit.simulated is None else replace(fit, values=dict(fit.values) | fit.relaxed_values)
    without = _held_out(standing, None, hold_out)
    before = _in_floors(without, floor)
    best, after, ties = judged(probing, ranked, before, error)
    curve = _curve(fit, best)
    size = _size(best, probing.problem)
    beyond = outside(fit, best.terms[0], [prepare(run, fit.plant, fit.noise) for run in hold_out])
    found = Found(
        fit, best, before, after, curve, size, distilled(best.terms[0], curve, fit), ties, beyond,
        gain=probing.start_cost - best.cost, errors=(without, _held_out(fit, best, hold_out)),
    )  # fmt: skip
    say(f"{_named(best.terms)}: removes {100 * found.explained:.0f} % of the held-out excess")
    return found if fit.simulated is None else _by_simulation(found, hold_out, floor, say)


def _by_simulation(found: Found, hold_out: Sequence[Recording], floor: Mapping[str, float], say: Say) -> Found:
    """``found`` measured against the simulated parameters of its fit, by those of the model with its terms where they help."""
    without = _held_out(found.fit, None, hold_out)
    helps, found = found.explains, replace(found, before=_in_floors(without, floor), errors=(without, found.errors[1]))
    return refitted(found, found.fit, hold_out, floor, say) if helps else found


def refitted(
    found: Found, fit: Fit, hold_out: Sequence[Recording], floor: Mapping[str, float], say: Say = lambda _: None
) -> Found:
    """What the search has found, as a fit of the model with its terms from there says where that is better.

    The joint fit moves along the base model's derivatives: of a valve whose ports saturate it left three times as much.
    """
    if found.refit:
        return found
    say(f"refitting with {_named(found.joint.terms)}")
    plant, start = _with_terms(fit, found.joint)
    end = estimate(plant, [run.recording for run in fit.runs], start, fit.noise, exact=False, prepared=fit.runs, again=True)
    return _where_it_ends(found, fit, end, hold_out, floor)


def identified(
    found: Found, fit: Fit, hold_out: Sequence[Recording], floor: Mapping[str, float], say: Say = lambda _: None
) -> Found:
    """What the search has found, as the model with its terms says, identified from the data alone, where that is better.

    A base model that is far off leads astray: beside a gain of p1 7 % too high the function ended at 103 floors along its
    derivatives, at 28 from there, and at 3 from the data.
    """
    say(f"identifying {_named(found.joint.terms)} from the data")
    plant, _ = _with_terms(fit, found.joint)
    end = estimate(plant, [run.recording for run in fit.runs], {}, fit.noise, prepared=fit.runs)
    return _where_it_ends(found, fit, end, hold_out, floor)


def _where_it_ends(found: Found, fit: Fit, end: Fit, hold_out: Sequence[Recording], floor: Mapping[str, float]) -> Found:
    """``found`` with errors, gain and shapes of a fit of the model with its terms, itself where that is no better."""
    held = [prepare(run, end.plant, end.noise) for run in hold_out]
    errors = rmse(predict(Frozen.of(end), held), end.plant.outputs)
    after = _in_floors(errors, floor)
    before, cost = comparable_costs(fit, end)
    gain = before - cost
    # what is simulated need not cost less with jumps
    if not (after < found.after and (gain > found.gain or end.simulated is not None)):
        return replace(found, refit=True)
    names = [spline(term).amplitudes for term in found.joint.terms]
    joint = replace(
        found.joint, amplitudes=tuple(np.array([end.values[name] for name in part]) for part in names),
        values={name: end.values[name] for name in found.joint.values}, cost=found.joint.cost + found.gain - gain,
    )  # fmt: skip
    curve = _curve(fit, joint)
    return replace(
        found, joint=joint, after=after, curve=curve, rms=_size(joint, Probed(fit)), gain=gain,
        formula=distilled(joint.terms[0], curve, fit), errors=(found.errors[0], errors), refit=True,
    )  # fmt: skip


def judged(
    probing: Probing, ranked: Sequence[Ranked], before: float, error: Callable[[Joint], float]
) -> tuple[Joint, float, tuple[Term, ...]]:
    """The joint fit that predicts the held-out runs best, its error there, and terms that explain all runs about as well.

    Where these bear none out, that which follows the training runs best. ``before`` : the error without any.
    """
    least = before - LEAST_EXPLAINED * (before - 1.0)
    near = _leaders(ranked, NEAR)
    others = [terms for terms in _leaders(ranked, FARTHER) if terms not in near] if before > FAR_OFF else []
    every = Ahead([partial(_tried, probing, terms, error) for terms in (*near, *others)])
    if len(near) > 1:
        every.begin()
    found = [every.result(i) for i in range(len(near))]
    if not any(then < least for then, _ in found):
        found += [every.result(len(near) + i) for i in range(len(others))]
    every.close()
    borne_out = [pair for pair in found if pair[0] < least]
    # the drop first, where chance alone decides on the held-out runs
    after, best = min(borne_out, key=lambda pair: pair[0]) if borne_out else min(found, key=lambda pair: pair[1].cost)
    both = _with_second(probing, ranked, best)
    if both is not best and (then := error(both)) < after:
        after, best = then, both
    gain, enough = probing.start_cost - best.cost, before - ALIKE * (before - after)
    alike = [joint for other, joint in found if joint.cost - best.cost < TIED * gain and (not borne_out or other < enough)]
    return best, after, tuple(joint.terms[0] for joint in alike if joint.terms[0] not in best.terms)


def _tried(probing: Probing, terms: tuple[Term, ...], error: Callable[[Joint], float]) -> tuple[float, Joint]:
    joint = probing.fitted(terms)
    return error(joint), joint


def _leaders(ranked: Sequence[Ranked], share: float) -> list[tuple[Term, ...]]:
    """The terms that promise a share of the most, not too many of one equation."""
    found: list[tuple[Term, ...]] = []
    for drop, terms in ranked:
        same = sum(other[0].equation == terms[0].equation for other in found)
        if drop >= share * ranked[0][0] and same < OF_ONE and len(found) < LEADERS:
            found.append(terms)
    return found


def ranking(probing: Probing) -> list[Ranked]:
    """Predicted drop of every term and of leaks across the piston, best first, with the number of splines that is worth it."""
    names = SERVO_TERMS if probing.problem.plant.servo else BENCH_TERMS
    found: list[tuple[float, tuple[Term]]] = []
    leaks: list[Ranked] = []
    for name in names:
        equation, _, rest = name.partition("(")
        signal, _, factor = rest.rstrip(")").partition("*")
        if signal == "psup" and float(np.ptp(probing.scope.psup)) < 1e4:
            continue
        drop, terms = _finest(probing, Term(equation, signal, factor))
        plain = [other for other, (term,) in found if (term.equation, term.signal) == (equation, signal)]
        if factor in PRESSURES and not _worth(probing, drop, max(plain)):
            continue  # at pressures that hardly change it is the function without that factor
        found.append((drop, terms))
    for signal, factor in LEAKS if probing.problem.plant.servo else ():
        alike = [(drop, term) for drop, (term,) in found if (term.signal, term.factor) == (signal, factor)]
        halves = {term.equation: (drop, term) for drop, term in alike}
        (one, first), (other, second) = halves["flow_1"], halves["flow_2"]
        drop = probing.screened(first, second)
        if drop > WORTH_KNOTS * max(one, other) + KNOTS:
            leaks.append((drop, (first, second)))
    return sorted([*found, *leaks], key=lambda item: -item[0])


def _finest(probing: Probing, term: Term) -> tuple[float, tuple[Term]]:
    """Predicted drop of a term, with more splines over its signal where they are worth it."""
    drop, best = probing.screened(term), term
    for knots in FINER.get(term.signal, ()):
        finer = replace(term, knots=knots)
        more = probing.screened(finer)
        if _worth(probing, more, drop, knots):
            drop, best = more, finer
    return drop, (best,)


def _worth(probing: Probing, more: float, drop: float, knots: int = 0) -> bool:
    """Whether a predicted drop is worth what it takes more, ``knots`` among it, than what promises ``drop``."""
    cost = probing.start_cost
    return more > WORTH_KNOTS * drop + knots or cost - more < WORTH_REST * (cost - drop) - knots


def _with_second(probing: Probing, ranked: Sequence[Ranked], best: Joint) -> Joint:
    """The joint fit with a second term beside the best one, where it promises much more."""
    if len(best.terms) > 1:
        return best
    first, single = best.terms[0], [terms[0] for _, terms in ranked if len(terms) == 1]
    equations = {term.equation for term in single} - {first.equation}
    others = [term for name in sorted(equations) for term in [item for item in single if item.equation == name][:SECONDS]]
    alone = probing.screened(first)
    pairs = [(probing.screened(first, other), other) for other in others]
    drop, second = max(pairs, key=lambda item: item[0], default=(0.0, first))
    if drop < WORTH_KNOTS * alone + KNOTS:
        return best
    both = probing.fitted([first, second])
    return both if best.cost - both.cost > (WORTH_KNOTS - 1.0) * (probing.start_cost - best.cost) else best


def _named(terms: Sequence[Term]) -> str:
    return " + ".join(term.name for term in terms)


def _held_out(fit: Fit, joint: Joint | None, hold_out: Sequence[Recording]) -> dict[str, float]:
    """Error per signal of the fitted model, with the unknown terms in place, on runs not used in the fit."""
    plant, values = (fit.plant, dict(fit.values)) if joint is None else _with_terms(fit, joint)
    held = [prepare(run, plant, fit.noise) for run in hold_out]
    return rmse(predict(Frozen(plant, values, fit.ranges, fit.noise, fit.substeps), held), plant.outputs)


def _in_floors(errors: Mapping[str, float], floor: Mapping[str, float]) -> float:
    """Mean over the signals of squared errors in noise floors."""
    return float(np.mean([(errors[name] / floor[name]) ** 2 for name in errors]))


def _with_terms(fit: Fit, joint: Joint) -> tuple[Plant, dict[str, float]]:
    """The model with the unknown terms in place, and its values (SI)."""
    effects, values = [spline(term) for term in joint.terms], dict(fit.values) | joint.values
    for effect, part in zip(effects, joint.amplitudes, strict=True):
        values |= dict(zip(effect.amplitudes, map(float, part), strict=True))
    return Plant(fit.plant.rig, fit.plant.law.name, [*fit.plant.effects, *effects]), values


def _size(joint: Joint, problem: Probed) -> float:
    """Root mean square of the first term over the runs fitted to, SI."""
    values = weights(joint.terms[0], problem.scope(problem.point)) @ joint.amplitudes[0]
    return float(np.sqrt(np.mean(values**2)))


def _curve(fit: Fit, joint: Joint) -> Curve:
    """Shape and band of the first term."""
    term, part = joint.terms[0], joint.amplitudes[0]
    at = np.linspace(*visited(fit.runs, term, fit), POINTS)
    columns = np.array(curve_columns(term, known_ranges(fit.plant, fit.ranges), at))
    covariance = joint.covariance[: part.size, : part.size]
    std = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", columns, covariance, columns), 0.0))
    value = part @ columns
    return Curve(
        spline(term).name, term.equation, term.signal, term.factor, term.unit, tuple(at.tolist()), tuple(value.tolist()),
        tuple(std.tolist()), provisional=True,
    )  # fmt: skip
