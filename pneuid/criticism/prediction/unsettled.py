"""What a fit leaves open of its parameters, as error on held-out runs: no effect is missing where only that shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import predict_apart, typical
from pneuid.criticism.prediction.noise_floor import NoiseFloor
from pneuid.estimation.curves import relaxed_covariance
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run

SURELY = 0.99
"""Probability with which chance stays below the error that is put down to it."""

LONGEST = 0.05
"""Longest step, in the search variables (of most parameters the logarithm), over which predictions are taken as linear."""


def unsettled(found: Fit, held: Sequence[Run], floor: NoiseFloor) -> float:
    """Squared typical error, in noise floors, that open parameters alone stay below on the runs ``held``, ``SURELY``.

    The training runs may say little of what the held-out runs ask for: friction at a speed that they do not reach. The
    parameters' covariance at the relaxed solution, or at the simulated one of a bench, is followed along its principal axes,
    one standard deviation each, to the predictions: each adds its share times a chi-square of one degree of freedom, their sum
    is taken as one of as many degrees as fit its mean and variance. Satterthwaite, Biometrics Bulletin 2 (1946) 110, eq. (17).
    """
    names, model = found.plant.outputs, Frozen.of(found)
    lengths, others = [], []
    for q, length in _along_axes(found):
        moved = dict(zip(found.problem.free, found.problem.scaling.to_values(q), strict=True))
        others.append(replace(model, values=dict(found.values) | moved))
        lengths.append(length)
    squares = [
        [(length * error / floor.value[name]) ** 2 for name, error in typical(apart, names).items()]
        for length, apart in zip(lengths, predict_apart(model, held, others), strict=True)
    ]
    shares = np.mean(np.reshape(squares, (len(squares), len(names))), axis=1)
    if not shares.sum() > 0.0:
        return 0.0
    unit = np.square(shares).sum() / shares.sum()
    return float(unit * chi2.ppf(SURELY, shares.sum() / unit))


def _along_axes(found: Fit) -> list[tuple[np.ndarray, float]]:
    """A step from the relaxed solution, on a bench from the simulated parameters, along each axis of the parameters'
    covariance: search variables ``(nq,)``, and the standard deviation in units of that step.

    What the data hardly see has a standard deviation over decades of its logarithm; there a short step is taken.
    """
    problem = found.problem
    q, scaling = found.relaxed.X[: problem.nq], problem.scaling
    slope = scaling.slope(q)
    if found.simulated is not None:
        q = scaling.to_q(np.array([found.values[name] for name in problem.free]))
        slope, covariance = scaling.slope(q), np.array(found.simulated.covariance)
    else:
        covariance = relaxed_covariance(found)
    variance, axes = np.linalg.eigh(covariance / np.outer(slope, slope))
    steps = []
    for size, axis in zip(np.sqrt(np.maximum(variance, 0.0)), axes.T, strict=True):
        short = min(size, LONGEST)
        if short > 0.0:
            steps.append((np.clip(q + short * axis, scaling.lower, scaling.upper), float(size / short)))
    return steps
