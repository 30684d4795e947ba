"""The joint multiple-shooting fit of bench runs: refined motion, settled sections averaged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pneuid.estimation.bench.sections import Section, constant_velocity_sections
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import Run, noise_of, prepare
from pneuid.estimation.solver import Monitor
from pneuid.plant import Plant
from pneuid.recording import Recording

BLOCK = 40
"""Settled samples of a constant-velocity section that are averaged into one."""

SETTLED = 2.0e-3
"""Travel in m after which friction has settled in a section, tens of bristle deflections; at most half the section."""

ENDS = 0.95
"""Share of a section's duration up to which it is settled: the ramp may reach into its end."""


def joint_fit(
    plant: Plant, recordings: Sequence[Recording], start: Mapping[str, float], monitor: Monitor | None = None
) -> Fit:
    """All parameters of ``plant`` from all runs at once; ``start`` (SI) is what the classic route found.

    Raises ``UserError`` for data that cannot identify the model.
    """
    noise = noise_of(plant.rig, recordings)
    runs = joint_runs(plant, recordings, noise)
    known = {name: value for name, value in start.items() if name in plant.parameter_names}
    found = fit(plant, [run.recording for run in runs], known, noise, monitor, prepared=runs)
    whole = tuple(replace(run, recording=raw) for run, raw in zip(found.runs, recordings, strict=True))
    return replace(found, runs=whole)


def joint_runs(plant: Plant, recordings: Sequence[Recording], noise: Mapping[str, float]) -> tuple[Run, ...]:
    """The runs for ``estimation.fit.fit`` of a bench, in the order of ``recordings``.

    In the settled part of constant-velocity sections, where force and speed stay, ``BLOCK`` samples become one with the weight
    of all. ``noise`` is 1-sigma per signal, SI.
    """
    return tuple(_thinned(prepare(run, plant, dict(noise)), noise["x"]) for run in recordings)


def _settled(t: np.ndarray, section: Section) -> tuple[int, int]:
    """First and last sample (exclusive) of the settled part of a section."""
    began, lasts = t[section.first], t[section.last - 1] - t[section.first]
    settling = min(0.5 * lasts, SETTLED / abs(section.v) + (1.0 - ENDS) * lasts)
    begin, end = np.searchsorted(t, [began + settling, began + ENDS * lasts])
    return int(begin), int(end)


def _thinned(run: Run, noise: float) -> Run:
    """The run with blocks of the settled parts averaged; inputs go linearly from one kept sample to the next."""
    starts, sizes = [], []
    at = 0
    for section in constant_velocity_sections(run.t, run.recording.signals["x"], noise):
        begin, end = _settled(run.t, section)
        blocks = max(end - begin, 0) // BLOCK
        starts += [np.arange(at, begin), begin + BLOCK * np.arange(blocks)]
        sizes += [np.ones(begin - at, dtype=int), np.full(blocks, BLOCK)]
        at = begin + BLOCK * blocks
    starts.append(np.arange(at, run.n))
    sizes.append(np.ones(run.n - at, dtype=int))
    first, size = np.concatenate(starts), np.concatenate(sizes)
    mean = np.add.reduceat(run.data, first, axis=1) / size
    count, outputs = len(run.inputs), len(run.outputs)
    data = run.data[:, first].copy()
    data[0] = np.diff(run.t[first], append=run.t[first[-1]] + run.data[0, first[-1]])
    steady = size > 1
    rows = slice(1, 1 + count)
    data[rows, steady] = mean[rows, steady]
    data[1 + count : 1 + 2 * count] = np.diff(data[rows], axis=1, append=data[rows, -1:]) / data[0]
    data[-2 * outputs : -outputs, steady] = mean[-2 * outputs : -outputs, steady]
    data[-outputs:, steady] = mean[-outputs:, steady] * np.sqrt(size[steady])
    note = f"{run.name}: {run.n} samples, {first.size} after averaging {BLOCK} at a time where settled"
    motion = replace(run.motion, x=run.motion.x[first], v=run.motion.v[first], a=run.motion.a[first])
    raw = run.recording
    signals = {name: np.add.reduceat(values, first) / size for name, values in raw.signals.items()}
    weights = {name: np.add.reduceat(values, first) / size for name, values in raw.weights.items()}
    kept = replace(raw, t=raw.t[first], signals=signals, weights=weights)
    notes = (*run.notes, note)
    return replace(run, t=run.t[first], data=data, motion=motion, contact=run.contact[first], recording=kept, notes=notes)
