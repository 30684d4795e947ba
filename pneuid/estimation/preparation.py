"""From a recording to the columns of numbers that the interval function runs on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.estimation.differentiate import Motion, spline_motion
from pneuid.estimation.end_stops import contact
from pneuid.estimation.motion import Speed, refined_motion
from pneuid.estimation.noise import sensor_noise
from pneuid.estimation.own import Own, own_of
from pneuid.estimation.robust import HUBER, pseudo_values
from pneuid.estimation.supply import smoothed_supply
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig


@dataclass(frozen=True, eq=False)
class Run:
    """One recording made ready.

    data : ``(rows, N)`` with rows dt, inputs, input slopes, measured outputs, weights (1/sigma, 0 where masked);
    own : what the run has for itself; notes : what was masked and how inputs were made; motion : smoothed
    position, speed and acceleration, one derivative for all users; contact : ``(N,)`` where the piston is at an end stop.
    A run is equal to itself alone: arrays have no single truth, and what is known of a run is kept by it.
    """

    name: str
    t: np.ndarray
    data: np.ndarray
    own: Own
    notes: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    recording: Recording
    motion: Motion
    contact: np.ndarray

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.data.shape[1])

    def measured(self, signal: str) -> np.ndarray:
        """Measured output (N,), SI."""
        return np.asarray(self.data[1 + 2 * len(self.inputs) + self.outputs.index(signal)])

    def weight(self, signal: str) -> np.ndarray:
        """Weight (N,) of a measured output, 1/sigma or 0."""
        first = 1 + 2 * len(self.inputs) + len(self.outputs)
        return np.asarray(self.data[first + self.outputs.index(signal)])

    def input(self, signal: str) -> np.ndarray:
        """Input (N,) at the samples, SI."""
        return np.asarray(self.data[1 + self.inputs.index(signal)])

    @property
    def weights(self) -> np.ndarray:
        """Weights ``(ny, N)``."""
        return np.asarray(self.data[-len(self.outputs) :])


def noise_of(rig: Rig, recordings: Sequence[Recording]) -> dict[str, float]:
    """1-sigma of every measured output and, on a bench, of the measured position and, where recorded, speed (SI)."""
    names = ["x", "p1", "p2"] if rig.kind == "servo" else ["F", "x"]
    if rig.kind == "bench" and all("v" in run.recorded for run in recordings):
        names.append("v")
    # without what was filled in between: a straight line has no noise
    seen = {name: [run.signals[name][run.weights[name] > 0] for run in recordings] for name in names}
    noise = sensor_noise(rig.noise, seen)
    # a noise-free record would have infinite weights; a tenth of a ppm of the range is below any sensor
    for name, value in noise.items():
        span = max(float(np.ptp(run.signals[name])) for run in recordings)
        noise[name] = max(value, 1e-7 * span)
    if rig.kind == "bench":
        # measured pressures are inputs there: their noise reaches the output as a force
        for name, area in (("p1", rig.A1), ("p2", rig.A2)):
            measured = [run.signals[name] for run in recordings if name in run.recorded]
            if measured:
                noise["F"] = float(np.hypot(noise["F"], area * sensor_noise(rig.noise, {name: measured})[name]))
    return noise


def prepare(recording: Recording, plant: Plant, noise: dict[str, float]) -> Run:
    """The run's columns for ``plant`` (SI, absolute pressures); ``noise`` as from ``noise_of``."""
    t, dt = recording.t, np.diff(recording.t, append=2 * recording.t[-1] - recording.t[-2])
    signals, notes = _without_outliers(recording, noise)
    # on a bench the motion is an input, and its error at a reversal would pass for friction
    motion = spline_motion(t, signals["x"], noise["x"]) if plant.servo else _imposed(recording, signals, noise)
    if plant.servo:
        given, more = _servo_inputs(recording, plant)
    else:
        given, more = _bench_inputs(recording, signals, plant, motion), _how_smoothed(recording.name, motion, noise)
    notes += more
    w = np.vstack([given[name] for name in plant.inputs])
    slopes = np.diff(w, axis=1, append=w[:, -1:]) / dt
    if plant.rig.input_hold == "zero-order" and plant.servo:
        slopes[plant.inputs.index("u")] = 0.0
    y = np.vstack([signals[name] for name in plant.outputs])
    weights = np.vstack([recording.weights[name] / noise[name] for name in plant.outputs])
    touching = contact(signals["x"], plant.rig.stroke) & plant.servo
    weights[:, touching] = 0.0
    if touching.any():
        words = "samples within 1 mm of an end stop are masked, and the model starts anew after each contact"
        notes.append(f"{recording.name}: {int(touching.sum())} {words}")
    data = np.vstack([dt, w, slopes, y, weights])
    own = own_of(plant.rig, recording)
    return Run(recording.name, t, data, own, tuple(notes), plant.inputs, plant.outputs, recording, motion, touching)


def _servo_inputs(recording: Recording, plant: Plant) -> tuple[dict[str, np.ndarray], list[str]]:
    """The command and the supply pressure, and what is to be said of how that was made."""
    signals = recording.signals
    if "psup" not in signals:
        own = plant.rig.run(recording.name).supply
        return {"u": signals["u"], "psup": np.full(recording.n, plant.rig.supply if own is None else own)}, []
    if "psup" not in recording.recorded:
        return {"u": signals["u"], "psup": signals["psup"]}, []
    noise = sensor_noise(plant.rig.noise, {"psup": [signals["psup"]]})["psup"]
    supply = smoothed_supply(recording.t, signals["psup"], noise, recording.weights["psup"])
    said = f"{recording.name}: psup smoothed by its noise, {noise / 1e3:.2g} kPa: followed up to {supply.bandwidth:.2g} Hz"
    return {"u": signals["u"], "psup": supply.pressure}, [said]


def _without_outliers(
    recording: Recording, noise: dict[str, float]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Signals with outliers drawn in, and what was found."""
    signals, notes = dict(recording.signals), []
    for name in ("x", "v", "p1", "p2", "F"):
        if name not in recording.recorded or name not in noise:
            continue
        y = signals[name]
        signals[name], found = pseudo_values(y, noise[name])
        if not found.any():
            continue
        far = np.abs(y - signals[name])[found] / noise[name] + HUBER
        notes.append(
            f"{recording.name}: {int(found.sum())} samples of {name} stand alone {far.min():.0f} to {far.max():.0f} noise "
            f"levels off (first at t = {recording.t[np.argmax(found)]:.4g} s); they count less (Huber's loss)"
        )
    return signals, notes


def _imposed(recording: Recording, signals: dict[str, np.ndarray], noise: dict[str, float]) -> Motion:
    """The motion that a bench imposes, from the position and, where all runs have it, the recorded speed."""
    speed = Speed(signals["v"], noise["v"]) if "v" in noise and "v" in recording.recorded else None
    return refined_motion(recording.t, signals["x"], noise["x"], speed)


def _how_smoothed(name: str, motion: Motion, noise: dict[str, float]) -> list[str]:
    """What the motion of a bench run was made from."""
    spread = motion.speed_noise
    source = "x" if spread is None else f"x and v (noise {noise['v'] * 1e3:.2g} mm/s)"
    made = (
        f"{name}: speed and acceleration from {source}, smoothed as its jerk allows, "
        f"bandwidth at most {motion.bandwidth:.3g} Hz at {noise['x'] * 1e6:.3g} um noise"
    )
    if spread is None or spread < 1.01 * noise["v"]:
        return [made]
    own = (
        f"{name}: the recorded v does not follow x within its noise (a gain, an offset or a filter of its own?); "
        f"it counts as if its noise were {spread * 1e3:.2g} mm/s"
    )
    return [made, own]


def _bench_inputs(
    recording: Recording, signals: dict[str, np.ndarray], plant: Plant, motion: Motion
) -> dict[str, np.ndarray]:
    still = np.full(recording.n, plant.rig.patm)
    return {"x": motion.x, "v": motion.v, "a": motion.a, "p1": signals.get("p1", still), "p2": signals.get("p2", still)}


def data_ranges(runs: Sequence[Recording], plant: Plant) -> dict[str, float]:
    """Ranges of position (m) and chamber pressures (Pa, absolute) over the runs, for laws that are clamped to them."""
    found: dict[str, float] = {}
    for name, least in (("p1", 1e3), ("p2", 1e3), ("x", 1e-3)):
        every = [run.signals[name] for run in runs if name in run.signals]
        low = min((float(y.min()) for y in every), default=plant.rig.patm)
        high = max((float(y.max()) for y in every), default=plant.rig.patm)
        if high - low < least:  # a constant signal still needs a range to divide by
            low, high = low - least, high + least
        found |= {f"{name}_low": low, f"{name}_high": high}
    return found
