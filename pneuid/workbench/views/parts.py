"""Small pieces that several views share: tables, notes, plots that refine on zoom, the live account of a job."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from pneuid.workbench.charts import cost_chart


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = (), name: str = "") -> None:
    """A plain table; columns ``right`` are set to the right; cells are text, never HTML."""
    with ui.element("table").classes("plain").props(f'data-testid="{name}"'):
        with ui.element("thead"), ui.element("tr"):
            for k, head in enumerate(heads):
                with ui.element("th").classes("r" if k in right else ""):
                    ui.label(head)
        with ui.element("tbody"):
            for row in rows:
                with ui.element("tr"):
                    for k, cell in enumerate(row):
                        with ui.element("td").classes("r" if k in right else ""):
                            ui.label(cell)


def note(text: str, kind: str = "note", name: str = "") -> ui.label:
    """A sentence with a coloured edge: good, warning or note."""
    label = ui.label(text).classes(f"panel {kind} w-full").style("padding:8px 12px")
    return label.props(f'data-testid="{name}"') if name else label


def zoomable(figure: Callable[[tuple[float, float] | None], dict[str, Any]], height: str, name: str,
             span: tuple[float, float] | None = None,
             on_span: Callable[[tuple[float, float] | None], None] | None = None) -> ui.plotly:  # fmt: skip
    """A plot over time that asks ``figure`` again for every range that is zoomed or panned to, None for the whole."""
    plot = ui.plotly(figure(span)).classes("w-full").style(f"height:{height}").props(f'data-testid="{name}"')

    def moved(event: Any) -> None:
        found = _range(event.args)
        if found is not None:
            now = None if found == _WHOLE else found
            plot.update_figure(figure(now))
            if on_span is not None:
                on_span(now)

    plot.on("plotly_relayout", moved, throttle=0.1)
    return plot


_WHOLE = (-math.inf, math.inf)


def _range(args: Any) -> tuple[float, float] | None:
    """The range of t that an event of the plot means, None where it means another axis."""
    if not isinstance(args, dict):
        return None
    if args.get("xaxis.autorange"):
        return _WHOLE
    pair = args.get("xaxis.range") or [args.get("xaxis.range[0]"), args.get("xaxis.range[1]")]
    try:
        low, high = float(pair[0]), float(pair[1])
    except (TypeError, ValueError, IndexError):
        return None
    return (low, high) if high > low else None


def chart(figure: dict[str, Any], height: str, name: str) -> ui.plotly:
    """A chart that is drawn once."""
    return ui.plotly(figure).classes("w-full").style(f"height:{height}").props(f'data-testid="{name}"')


def live_job(page: Any, height: str = "250px") -> None:
    """What the running or last job does: its cost iteration by iteration, its sentences."""
    bench = page.bench
    job = bench.job
    plot = chart(cost_chart(job.costs if job else (), page.ink), height, "cost-chart")
    words = ui.label(_account(job)).classes("soft").props('data-testid="job" role="status"')
    lines = ui.column().classes("gap-0 w-full")
    seen: dict[str, Any] = {"costs": len(job.costs) if job else 0, "sentences": 0, "words": ""}

    def refresh() -> None:
        """Show what the job has said since."""
        now = bench.job
        if now is None:
            return
        if len(now.costs) != seen["costs"]:
            seen["costs"] = len(now.costs)
            plot.update_figure(cost_chart(now.costs, page.ink))
        account = _account(now)
        if account != seen["words"]:
            seen["words"] = account
            words.set_text(account)
        for second, sentence in now.sentences[seen["sentences"] :]:
            with lines:
                ui.label(f"{second:5.1f} s  {sentence}").classes("soft")
        seen["sentences"] = len(now.sentences)

    refresh()
    page.ticks.append(refresh)


def _account(job: Any) -> str:
    if job is None:
        return "no job has run yet"
    text = f"{job.title}: {job.state}, {job.seconds:.0f} s"
    if job.costs:
        stage, iteration, cost = job.costs[-1]
        text += f"; {stage} stage, iteration {iteration}, cost per sample {cost:.4g}"
    return f"{text}; {job.message.splitlines()[0]}" if job.message else text


def model_choice(page: Any) -> None:
    """Which model of the project the views are about."""
    bench = page.bench
    models = bench.project.models()
    if not models:
        return

    def chosen(event: Any) -> None:
        bench.model = event.value
        bench.revision += 1

    value = bench.model if bench.model in models else models[-1]
    ui.select(models, value=value, label="model", on_change=chosen).props("dense outlined options-dense").classes(
        "min-w-[170px]"
    )
