"""``python -m pneuid.effects``: the catalogue, or one effect in full."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from pneuid.effect import Effect
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.physics.friction import LAWS
from pneuid.story import demo_runs
from pneuid.terminal import CommandParser, run_command


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for a name that is not in the catalogue."""
    parser = CommandParser(
        "python -m pneuid.effects", "List the catalogue of physical effects, or one in full.",
        "example:\n  python -m pneuid.effects leakage_internal",
    )  # fmt: skip
    parser.add_argument("name", nargs="?", metavar="NAME", help="one effect")
    given = parser.parse_args(arguments)
    console = Console(highlight=False)
    if given.name:
        _show(console, effects_by_name((given.name,))[0])
    else:
        _list(console)


def _list(console: Console) -> None:
    table = Table("effect", "equation", "mechanism", "revealed by")
    for effect in CATALOGUE.values():
        table.add_row(effect.name, effect.equation, effect.mechanism, effect.experiment)
    console.print(table)
    console.print(f"next: python -m pneuid.effects {next(iter(CATALOGUE))}")


def _show(console: Console, effect: Effect) -> None:
    console.print(f"[bold]{effect.name}[/bold] (equation {effect.equation}, {' and '.join(effect.rigs)} rigs)")
    console.print(effect.mechanism)
    console.print(inspect.cleandoc(effect.__doc__ or ""), markup=False)
    table = Table("parameter", "unit", "lower", "upper", "off", "typical size", title="on the demonstration rig")
    for item in effect.parameters(demo_runs().rig, LAWS["lugre"]):
        off = "shape" if item.off is None else f"{item.off:.4g}"
        table.add_row(item.name, item.unit, f"{item.lower:.3g}", f"{item.upper:.3g}", off, f"{item.scale:.3g}")
    console.print(table)
    for item in effect.parameters(demo_runs().rig, LAWS["lugre"]):
        if item.source != effect.reference:
            console.print(f"{item.name} after {item.source}", markup=False)
    console.print(f"revealed by: {effect.experiment}")
    console.print(f"easily confused with: {', '.join(effect.confused_with) or 'none'}")
    console.print(f"source: {effect.reference}")


if __name__ == "__main__":
    run_command(main)
