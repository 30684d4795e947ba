"""What the computing processes send to the page: arrays in display units with their labels, nothing of the model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Channel:
    """One signal over time: axis label with unit, values (N,) in that unit, NaN where there is none."""

    label: str
    values: np.ndarray


@dataclass(frozen=True)
class RunData:
    """A recording as it is shown: t (N,) in s; ``preview`` when thinned and not yet checked as a whole."""

    name: str
    t: np.ndarray
    channels: dict[str, Channel]
    samples: int
    rate: float
    notes: tuple[str, ...] = ()
    preview: bool = False


@dataclass(frozen=True)
class RawPreview:
    """The head of a file as it stands: columns, the units their headers state, some rows as text.

    ``layout``: the keys of ``[files]`` it was read with, empty where the file is not text; ``fault``: why it cannot be read
    with them, ``rows`` being the plain lines then.
    """

    name: str
    columns: tuple[str, ...]
    units: dict[str, str]
    rows: tuple[tuple[str, ...], ...]
    layout: dict[str, Any] = field(default_factory=dict)
    fault: str = ""
    known_signals: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    mapped: dict[str, tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class SignalView:
    """One output of one run: measured, predicted and error (N,) in the unit of their labels; band = 2 noise floors."""

    label: str
    measured: np.ndarray
    ahead: np.ndarray
    free: np.ndarray | None
    error_label: str
    error: np.ndarray
    band: float


@dataclass(frozen=True)
class RunView:
    """One run of a comparison: outputs, the signals to plot against, and the samples (N,) of every region."""

    name: str
    role: str
    t: np.ndarray
    outputs: dict[str, SignalView]
    features: dict[str, Channel]
    context: str
    regions: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class RegionRow:
    """One region where the error concentrates, in words."""

    signal: str
    share: float
    samples: float
    text: str


@dataclass(frozen=True)
class DefectRow:
    """What a balance leaves unexplained, beside what noise alone leaves."""

    equation: str
    unit: str
    rms: float
    expected: float


@dataclass(frozen=True)
class ComparisonView:
    """A model held against the runs."""

    model: str
    runs: tuple[RunView, ...]
    regions: tuple[RegionRow, ...]
    defects: tuple[DefectRow, ...]
    telling: int


@dataclass(frozen=True)
class ParameterRow:
    """A parameter that a fit would have, SI."""

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    start: float
    owner: str


@dataclass(frozen=True)
class EffectCard:
    """What the catalogue says of an effect."""

    name: str
    mechanism: str
    equation: str
    experiment: str
    reference: str
    confused_with: tuple[str, ...]


@dataclass(frozen=True)
class SignatureRow:
    """One output of a signature (N,): responses without and with the effect, their difference in a unit of its own."""

    label: str
    without: np.ndarray
    with_it: np.ndarray
    change_label: str
    change: np.ndarray
    band: float


@dataclass(frozen=True)
class SignatureView:
    """How an effect of typical size shows on this rig, in the experiment that tells most: t (N,) in s."""

    effect: str
    experiment: str
    t: np.ndarray
    command: Channel
    rows: tuple[SignatureRow, ...]
