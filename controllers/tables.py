"""What a study says, as tables of text: the terminal and the written report show the same ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from controllers import loop
from controllers.candidates import WITH, WITHOUT
from controllers.grid import Result
from controllers.registry import CONTROLLERS

Pick = Callable[[loop.Metrics], float]


@dataclass(frozen=True)
class Grid:
    """A table: title, heads and rows of the same length; the first column is text, the others numbers."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """As Markdown, with its title in front."""
        lines = [f"**{self.title}**", "", _line(self.heads), _line(["---", *["---:"] * (len(self.heads) - 1)])]
        return "\n".join([*lines, *map(_line, self.rows)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def label_of(results: Sequence[Result], controller: str, model: str) -> str:
    """A controller's name, with its model's where the study has several for it."""
    models = {result.model for result in results if result.controller == controller}
    name = CONTROLLERS[controller].label
    return name if len(models) == 1 else f"{name}, {model}"


def variants(results: Sequence[Result]) -> list[tuple[str, str]]:
    """``(controller, model)`` in the order of the registry, models of one controller beside each other."""
    pairs = dict.fromkeys((result.controller, result.model) for result in results)
    return sorted(pairs, key=lambda pair: list(CONTROLLERS).index(pair[0]))


def chosen(results: Sequence[Result], **wanted: object) -> list[Result]:
    """Results whose named fields have the wanted values."""
    return [own for own in results if all(getattr(own, name) == value for name, value in wanted.items())]


def rms(results: Sequence[Result]) -> float:
    """Root of the mean square error over loops, mm; infinite where one diverged, NaN without any."""
    if any(result.metrics is None for result in results):
        return math.inf
    squares = [result.metrics.rms**2 for result in results if result.metrics is not None]
    return 1e3 * math.sqrt(sum(squares) / len(squares)) if squares else math.nan


def largest(results: Sequence[Result], pick: Pick, factor: float = 1.0) -> float:
    """Largest of a metric over loops, NaN where none has it, infinite where one diverged."""
    if any(result.metrics is None for result in results):
        return math.inf
    known = [
        value for value in (pick(own.metrics) for own in results if own.metrics is not None) if not math.isnan(value)
    ]
    return factor * max(known) if known else math.nan


def shown(value: float, digits: int) -> str:
    """A number for a table; empty without one."""
    if math.isnan(value):
        return ""
    return "diverged" if math.isinf(value) else f"{value:.{digits}f}"


def tracking(results: Sequence[Result], patm: float) -> Grid:
    """RMS error in mm per supply and reference under the first condition; then the worst over references and seeds."""
    first = chosen(results, condition=results[0].condition)
    references = list(dict.fromkeys(result.reference for result in first))
    rows = []
    for controller, model in variants(first):
        own = chosen(first, controller=controller, model=model)
        for supply in dict.fromkeys(result.supply for result in own):
            here = chosen(own, supply=supply)
            cells = [shown(rms(chosen(here, reference=name)), 3) for name in references]
            worst = (
                shown(largest(here, lambda m: m.peak, 1e3), 2), shown(largest(here, lambda m: m.worst_steady, 1e6), 0),
                shown(largest(here, lambda m: m.wander, 1e6), 0), shown(largest(here, lambda m: m.travel), 0),
                shown(largest(here, lambda m: m.step_median, 1e6), 0),
            )  # fmt: skip
            rows.append((label_of(first, controller, model), f"{(supply - patm) / 1e5:g}", *cells, *worst))
    heads = (
        "controller",
        "supply bar",
        *references,
        "max mm",
        "steady um",
        "standstill p-p um",
        "valve V/s",
        "step us",
    )
    return Grid("RMS tracking error in mm; on the right the worst over the references", heads, tuple(rows))


def by_condition(
    results: Sequence[Result], title: str, measure: Callable[[Sequence[Result]], float], digits: int
) -> Grid:
    """One number per controller and condition: ``measure`` over supplies, references and seeds."""
    conditions = list(dict.fromkeys(result.condition for result in results))
    rows = []
    for name in conditions:
        cells = [
            shown(measure(chosen(results, condition=name, controller=controller, model=model)), digits)
            for controller, model in variants(results)
        ]
        rows.append((name, *cells))
    return Grid(title, ("condition", *(label_of(results, *pair) for pair in variants(results))), tuple(rows))


def spread(results: Sequence[Result], design_supply: float) -> float:
    """By how much the error at another supply exceeds that at the design's, largest over references; percent."""
    worst = -math.inf
    for reference in dict.fromkeys(result.reference for result in results):
        here = chosen(results, reference=reference)
        nearest = min((result.supply for result in here), key=lambda value: abs(value - design_supply))
        base = rms(chosen(here, supply=nearest))
        worst = max(worst, *(rms(chosen(here, supply=own)) / base - 1.0 for own in {result.supply for result in here}))
    return 100.0 * worst


def uniformity(results: Sequence[Result], design_supply: float, patm: float) -> Grid:
    """RMS error over all references per supply, and how uneven the worst reference is."""
    first = chosen(results, condition=results[0].condition)
    supplies = list(dict.fromkeys(result.supply for result in first))
    rows = []
    for controller, model in variants(first):
        own = chosen(first, controller=controller, model=model)
        cells = [shown(rms(chosen(own, supply=supply)), 3) for supply in supplies]
        rows.append((label_of(first, controller, model), *cells, shown(spread(own, design_supply), 0)))
    heads = (
        "controller",
        *(f"{(supply - patm) / 1e5:g} bar" for supply in supplies),
        "worst reference, % above design",
    )
    return Grid("Uniformity over pressure: RMS error in mm over all references", heads, tuple(rows))


def prices(results: Sequence[Result], patm: float) -> Grid:
    """Error without and with each effect in the controller's model, per controller and supply; mm, over references."""
    rows = []
    for effect in dict.fromkeys(result.condition for result in results):
        here = chosen(results, condition=effect)
        for controller in dict.fromkeys(result.controller for result in here):
            cells: list[str] = []
            for supply in dict.fromkeys(result.supply for result in here):
                at = chosen(here, controller=controller, supply=supply)
                was, now = (rms(chosen(at, model=words + effect)) for words in (WITHOUT, WITH))
                cells += [shown(was, 3), shown(now, 3), f"{1e3 * (was - now):+.0f}" if math.isfinite(was - now) else ""]
            rows.append((effect, CONTROLLERS[controller].label, *cells))
    supplies = [f"{(supply - patm) / 1e5:g} bar" for supply in dict.fromkeys(result.supply for result in results)]
    heads = [f"{at}, {words}" for at in supplies for words in ("without mm", "with mm", "price um")]
    title = "What a missing effect costs: RMS error in mm when the controller's model lacks it and when it has it"
    return Grid(title, ("effect of the rig", "controller", *heads), tuple(rows))


def tables(results: Sequence[Result], design_supply: float, patm: float) -> list[Grid]:
    """All tables that a study's results allow."""
    if any(result.model.startswith(WITHOUT) for result in results):
        return [prices(results, patm)]
    found = [tracking(results, patm), uniformity(results, design_supply, patm)]
    if len({result.condition for result in results}) > 1:
        found += [
            by_condition(results, "RMS error in mm over supplies, references and seeds, by condition", rms, 3),
            by_condition(
                results,
                "Worst standstill motion, peak to peak, um",
                lambda own: largest(own, lambda m: m.wander, 1e6),
                0,
            ),
            by_condition(
                results,
                "Largest mean error at standstill, um",
                lambda own: largest(own, lambda m: m.worst_steady, 1e6),
                0,
            ),
            by_condition(results, "Valve effort, V/s, worst loop", lambda own: largest(own, lambda m: m.travel), 0),
        ]
    return found
