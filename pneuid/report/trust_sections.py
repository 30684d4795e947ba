"""The sections of a report that say how far the numbers can be trusted: intervals, correlations, laws, loops, profiles."""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.comparison.trust import recordings_wanted, strong_pairs, trust
from pneuid.estimation.profile import Profile
from pneuid.report.html import Items, Paragraph, Part, Picture, Section, Table
from pneuid.report.loop_figure import loops
from pneuid.report.profile_figure import profiles_figure
from pneuid.report.quantities import handy, number
from pneuid.report.trust_figures import correlation_map, depends_on_pressure, mapped, pressure_laws


def trust_section(comparison: Comparison, profiles: Sequence[Profile] = ()) -> Section:
    """95 % intervals, what to record next, correlations, profiles of the parameters asked for."""
    found = trust(comparison.model)
    rows = []
    for item in found:
        unit, factor = handy(item.estimate.unit)
        name = item.estimate.name if item.estimate.run is None else f"{item.estimate.name} (run {item.estimate.run})"
        ends = [number(end * factor, 4) if end is not None else "—" for end in (item.low, item.high)]
        rows.append((name, *ends, unit, item.estimate.verdict))
    caption = "95 % intervals from the curvature of the cost at the fit, for the sensors' noise; model errors are not in them."
    table = Table(("parameter", "from", "to", "unit", "verdict"), tuple(rows), "lrrnn", caption)
    relaxed = Paragraph("Standard errors and intervals come with an exact fit; this one is relaxed.")
    parts: list[Part] = [table if any(item.estimate.std is not None for item in found) else relaxed]
    wanted = recordings_wanted(found)
    if wanted:
        parts.append(Paragraph("What to record next, for parameters that these data do not determine well:"))
        parts.append(Items(tuple(f"{record[:1].upper()}{record[1:]}: {', '.join(names)}" for record, names in wanted)))
    spread = comparison.spread
    if spread is not None and len(mapped(spread)) > 1:
        pairs = strong_pairs(spread)
        if pairs:
            words = ", ".join(f"{pair.first} and {pair.second} ({pair.correlation:+.2f})" for pair in pairs[:6])
            parts.append(Paragraph(f"Determined together rather than each for itself: {words}.", "note"))
        parts.append(Picture(correlation_map(comparison.model, spread), "Correlation of the parameters' errors"))
    if profiles:
        parts += [Items(tuple(_profile_words(item) for item in profiles)), _profile_picture(profiles)]
    return Section("How far to trust the numbers", tuple(parts))


def _profile_words(item: Profile) -> str:
    unit, factor = handy(item.unit)
    low = "open below" if item.low is None else f"from {number(item.low * factor, 5)}"
    high = "open above" if item.high is None else f"to {number(item.high * factor, 5)}"
    return f"{item.name}: 95 % interval {low} {high} {unit} by profile likelihood"


def _profile_picture(profiles: Sequence[Profile]) -> Picture:
    caption = (
        "Rise of the best cost when the parameter is held at a value and all others are fitted again. A curve that leaves "
        "the dashed parabola says that the standard error is not the whole truth; one that stays below the line, that "
        "the data leave the parameter open to that side."
    )
    return Picture(profiles_figure(profiles), "Profile likelihood", caption)


def friction_section(comparison: Comparison) -> Section | None:
    """Friction laws over pressure and force-displacement loops, None where there is nothing to draw."""
    parts: list[Part] = []
    if depends_on_pressure(comparison.model):
        caption = "Coefficients as the model has them over the pressures that it was fitted on."
        parts.append(Picture(pressure_laws(comparison), "Friction coefficients over pressure", caption))
    if any(item.index.size for item in comparison.free):
        caption = "Force over position, measured beside simulated. The width of a loop is twice the friction."
        parts.append(Picture(loops(comparison), "Force over position", caption))
    return Section("Friction", tuple(parts)) if parts else None
