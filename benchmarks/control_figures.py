"""The control figures of the design, with models identified from noisy recordings of the virtual rig.

    python benchmarks/control_figures.py --out figures [--seed 1] [--workers 2] [--resume]

The rig's friction follows the chamber pressures by the 2011 laws. Three models are identified (`controllers.candidates`):
pressure laws, from recordings at 3 and 7 bar gauge; constant friction, from recordings at 5 bar; constant friction from the
same recordings as the laws. Controllers are tuned on their own model for 5 bar and played at 3, 5 and 7. One alpha for every
figure. Prints each figure asked beside the one measured; baselines that are better are named.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from controllers.candidates import (
    AWARE,
    CONSTANT,
    EVERY_PRESSURE,
    Identification,
    candidates_of,
    compensating,
    identified,
)
from controllers.conditions import AS_KNOWN, Condition
from controllers.grid import Candidate, Result, run_study
from controllers.references import Sine, Smooth, Steps
from controllers.registry import CONTROLLERS
from controllers.scenario import Recordings, Scenario
from controllers.tables import chosen, largest, rms, tables
from controllers.tuning import ALPHA, Design
from pneuid.model import load
from pneuid.pool import Pool, open_pool
from pneuid.store import Store
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.truth import TruthServo

SUPPLIES = (3.0, 5.0, 7.0)
AVERAGE = "constant friction, all pressures"
SINE = Sine("sine 1 Hz", 0.25, 3.0, 0.05, 1.0, 0.5)
RANDOM = Smooth("random", 0.25, 4.0, 0.06, 1.5, 0.5, seed=3)
STEPS = Steps("steps", 0.15, 4.8, (0.01, 0.11, 0.111, 0.3), 1.2, 0.4)
WRONG = (
    Condition("friction -30 %", friction=0.7),
    Condition("friction +30 %", friction=1.3),
    Condition("valve gain -15 %", valve_gain=0.85),
    Condition("valve gain +15 %", valve_gain=1.15),
    Condition("mass +50 %", hidden=Hidden(load_mass=1.2)),
    Condition("dead zone 5 %", hidden=Hidden(valve_dead_zone=0.05)),
    Condition("noise 20 um", x_noise=20e-6),
)


def main() -> None:
    """Identify, play, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1, help="of the recordings' motion and noise and of the loops' noise")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--resume", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    store = Store(given.out / "done.jsonl") if given.resume else fresh(given.out / "done.jsonl")
    truth = replace(TruthServo(), friction=FRICTION_2011)
    supplies = tuple(truth.patm + bar * 1e5 for bar in SUPPLIES)
    tracking = Scenario(
        "tracking", ("pid", "cascade", "cascade_eso", "servo", "nmpc_eso", "nmpc"), supplies, (SINE, RANDOM, STEPS),
        Design(supplies[1], ALPHA), seeds=(given.seed,), models="identified", recordings=Recordings(seed=given.seed),
    )  # fmt: skip
    unheld = replace(tracking, controllers=("servo",), references=(STEPS,), design=replace(tracking.design, hold=0.0))
    wrong = replace(
        tracking,
        controllers=("pid", "cascade_eso", "servo", "nmpc"),
        references=(STEPS,),
        conditions=(AS_KNOWN, *WRONG),
    )
    with open_pool(given.workers) as pool:
        candidates = candidates_of(tracking, truth, NOTHING, pool, store, given.out, said)
        average = averaged(truth, tracking.recordings, given.out / "models" / "average.json", pool)
        aware = [own for own in candidates if own.label == AWARE]

        def play(scenario: Scenario, own: Sequence[Candidate]) -> list[Result]:
            return run_study(scenario, own, truth, NOTHING, pool=pool, store=store)

        report(play(tracking, [*candidates, average]), play(unheld, aware), play(wrong, aware), supplies, truth.patm)


def fresh(path: Path) -> Store:
    """A store that forgets what ``path`` held."""
    path.unlink(missing_ok=True)
    return Store(path)


def said(words: str) -> None:
    """Progress."""
    print(words, flush=True)


def averaged(truth: TruthServo, recordings: Recordings, path: Path, pool: Pool) -> Candidate:
    """Constant friction from the very recordings that the pressure laws are found in."""
    if not path.exists():
        sensors = Scenario("", (), (), (), Design(0.0)).sensors
        task = Identification(AVERAGE, truth, NOTHING, sensors, EVERY_PRESSURE, recordings, ())
        ((_, model),) = pool.each(identified, [task])
        model.save(path)
    model = load(path)
    return Candidate(AVERAGE, model.plant, model.theta(), controllers=compensating())


def line(asked: str, measured: str, met: bool) -> None:
    """One row of the result."""
    print(f"| {asked} | {measured} | {'yes' if met else '**no**'} |")


def numbers(values: Sequence[float], digits: int = 3) -> str:
    """Values at the three supplies."""
    return " / ".join(f"{value:.{digits}f}" for value in values)


def at(results: Sequence[Result], controller: str, reference: str, model: str = AWARE) -> list[float]:
    """RMS error in mm at each supply; the controllers without friction model are made from the model with the laws."""
    own = chosen(results, controller=controller, reference=reference, model=model)
    return [rms(chosen(own, supply=supply)) for supply in sorted({result.supply for result in own})]


def report(
    results: Sequence[Result], unheld: Sequence[Result], wrong: Sequence[Result], supplies: Sequence[float], patm: float
) -> None:
    """The figures of the design's section 6 beside what was measured, then the tables behind them."""
    print(f"\nalpha {ALPHA}; three numbers are 3 / 5 / 7 bar gauge\n\n| asked | measured | met |\n| --- | --- | --- |")
    predictive(results)
    servo(results, unheld, supplies)
    for controller in ("servo", "nmpc"):
        for name in dict.fromkeys(own.condition for own in wrong):
            own = chosen(wrong, controller=controller, condition=name)
            wander = [largest(chosen(own, supply=supply), lambda m: m.wander, 1e6) for supply in supplies]
            line(f"{controller}, {name}: <= 100 um peak to peak", f"{numbers(wander, 0)} um", max(wander) <= 100.0)
    print(
        "\nwhere a controller without friction model is better than the servo or the NMPC with identified pressure laws:"
    )
    for text in better(results, [f"{(supply - patm) / 1e5:.0f}" for supply in supplies]):
        print(text)
    for grid in tables(results, supplies[1], patm) + tables(wrong, supplies[1], patm)[2:]:
        print("\n" + grid.markdown())


def predictive(results: Sequence[Result]) -> None:
    """Rows of the predictive controller."""
    for name in ("sine 1 Hz", "random"):
        found = at(results, "nmpc", name)
        line(f"NMPC {name}: <= 0.1 mm RMS", f"{numbers(found)} mm", max(found) <= 0.1)
        uneven = [100.0 * (value / found[1] - 1.0) for value in (found[0], found[2])]
        words = f"{uneven[0]:+.0f} % / {uneven[1]:+.0f} %"
        line(f"NMPC {name}: 3 and 7 bar within 15 % of 5 bar", words, max(map(abs, uneven)) <= 15.0)
        for model in (CONSTANT, AVERAGE):
            other, share = at(results, "nmpc", name, model), 30.0 if name == "random" else 15.0
            gain = [100.0 * (1.0 - found[i] / other[i]) for i in (0, 2)]
            words = f"{numbers(other)} mm there: {gain[0]:.0f} % / {gain[1]:.0f} % below"
            line(f"NMPC {name}: >= {share:.0f} % below {model}, at 3 / 7 bar", words, min(gain) >= share)


def servo(results: Sequence[Result], unheld: Sequence[Result], supplies: Sequence[float]) -> None:
    """Rows of the servo but for robustness."""
    found = at(results, "servo", "sine 1 Hz")
    line("servo sine 1 Hz: <= 0.2 mm RMS", f"{numbers(found)} mm", max(found) <= 0.2)
    for words, own, limit in (("steady state", chosen(results, model=AWARE), 25.0), ("hold band off", unheld, 10.0)):
        steady = [largest(chosen(own, controller="servo", supply=s), lambda m: m.worst_steady, 1e6) for s in supplies]
        line(f"servo, {words}: <= {limit:.0f} um worst", f"{numbers(steady, 1)} um", max(steady) <= limit)


def better(results: Sequence[Result], supplies: Sequence[str]) -> Iterator[str]:
    """One line per case in which a controller without friction model wins."""
    for name in dict.fromkeys(own.reference for own in results):
        for ours in ("servo", "nmpc"):
            for other in (own for own in CONTROLLERS if not CONTROLLERS[own].compensates):
                pairs = zip(supplies, at(results, ours, name), at(results, other, name), strict=True)
                yield from (
                    f"- {name}, {bar} bar: {other} {b:.3f} mm, {ours} {a:.3f} mm" for bar, a, b in pairs if b < a
                )


if __name__ == "__main__":
    main()
