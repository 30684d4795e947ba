"""What a run does not forget starts as in the runs fitted to: a warmth is no free level of friction of the run judged."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import rig

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import predict, typical
from pneuid.criticism.prediction.unseen import unseen
from pneuid.criticism.refitting.trial import judge_of
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import ATMOSPHERE, Friction, Hidden, TruthBench, record_bench, strokes

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})
SPEEDS = [0.004, 0.03, 0.08]


def recorded(pairs: list[tuple[float, float]], hidden: Hidden) -> list[Recording]:
    """A run of strokes at each pair of pressures [bar gauge]."""
    truth = TruthBench(friction=Friction())
    records = [
        record_bench(truth, 1e5 * p1 + ATMOSPHERE, 1e5 * p2 + ATMOSPHERE, strokes(SPEEDS, longest=0.6, dwell=0.2), hidden, k)
        for k, (p1, p2) in enumerate(pairs)
    ]
    return [Recording.from_arrays(f"b{k}.csv", STAND, **record) for k, record in enumerate(records)]


def warm(runs: list[Recording]) -> Fit:
    """The base model with a warmth, fitted."""
    return fit(Plant(STAND, "lugre", [CATALOGUE["friction_warmup"]]), runs, {"w_warm": 0.1}, exact=False)


def test_friction_by_pressure_is_no_warmth_where_the_judged_run_does_not_tell_its_own():
    every = recorded([(1.0, 1.0), (6.0, 6.0), (6.0, 6.0)], Hidden(friction_pressure=0.6))
    found = warm(every[:2])
    held = [prepare(every[2], found.plant, found.noise)]
    told, untold = (typical(one, ["F"])["F"] for one in (predict(Frozen.of(found), held), unseen(found, held)))
    assert untold > 3.0 * told


def test_a_warmth_that_starts_cold_in_each_run_needs_no_telling():
    every = recorded([(3.0, 3.0)] * 3, Hidden(friction_warmup=0.5))
    found = warm(every[:2])
    held = [prepare(every[2], found.plant, found.noise)]
    told, untold = (typical(one, ["F"])["F"] for one in (predict(Frozen.of(found), held), unseen(found, held)))
    assert untold == pytest.approx(told, rel=0.3)


def test_without_states_of_effects_both_are_the_same():
    every = recorded([(3.0, 3.0), (2.0, 4.0)], Hidden())
    found = fit(Plant(STAND, "lugre"), every[:1], exact=False)
    judge = judge_of(found, [prepare(every[1], found.plant, found.noise)])
    trial = judge.trial(found)
    assert judge.unseen(trial) == trial.error
    np.testing.assert_array_equal(unseen(found, judge.held)[0].predicted, predict(Frozen.of(found), judge.held)[0].predicted)
