"""``python -m pneuid.effects``: the catalogue, or one effect in full, with a picture of its signature."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

from rich.console import Console
from rich.table import Column, Table

from pneuid.criticism.screening.signature import signature
from pneuid.effect import Effect
from pneuid.effects import CATALOGUE, GROUPS, easily_confused, effects_by_name, group_of
from pneuid.errors import UserError
from pneuid.physics.friction import LAWS
from pneuid.report.quantities import handy
from pneuid.report.signature_figure import signature_figure
from pneuid.report.style import png
from pneuid.resources import scenario_path
from pneuid.rig import Rig
from pneuid.terminal import CommandParser, add_output_options, result_folder, run_command


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for a name that is not in the catalogue, or a folder that may not be used."""
    parser = CommandParser(
        "python -m pneuid.effects", "List the catalogue of physical effects, or one in full.",
        "example:\n  python -m pneuid.effects leakage_internal --out results/leak",
    )  # fmt: skip
    parser.add_argument("name", nargs="?", metavar="NAME", help="one effect")
    parser.add_argument("--names", action="store_true", help="the names alone, one in a line, for scripts")
    add_output_options(parser)
    given = parser.parse_args(arguments)
    console = Console(highlight=False)
    if given.names:
        if given.name or given.out:
            raise UserError("--names lists the catalogue; it goes with no effect and no --out")
        for name in CATALOGUE:
            console.print(name, markup=False)
        return
    if not given.name:
        if given.out:
            raise UserError("--out is for the picture of one effect; name the effect too")
        _list(console)
        return
    effect = effects_by_name((given.name,))[0]
    rig = demonstration_rig(effect)
    if given.out:
        path = result_folder(given.out, "effects", embedded=False, overwrite=given.overwrite) / f"{effect.name}.png"
        path.write_bytes(png(signature_figure(signature(effect, rig), rig.patm)))
    _show(console, effect, rig)
    if given.out:
        console.print(f"picture: {path}", markup=False, soft_wrap=True)
    else:
        console.print(f"next: python -m pneuid.effects {effect.name} --out signature", soft_wrap=True)


def demonstration_rig(effect: Effect) -> Rig:
    """The rig of the demonstration, or the same cylinder on a bench for an effect that shows on a bench alone."""
    servo = Rig.from_toml(scenario_path("demo/rig.toml"))
    if "servo" in effect.rigs:
        return servo
    raw = servo.to_dict()
    kept = {name: raw[name] for name in ("friction", "conventions", "load")}
    cylinder = {name: raw["cylinder"][name] for name in ("bore", "rod", "stroke")}
    return Rig.from_dict({**kept, "kind": "bench", "cylinder": cylinder, "sensors": {"x": "0.3 um", "F": "0.2 N"}})


def _list(console: Console) -> None:
    for group in GROUPS:
        members = [effect for effect in CATALOGUE.values() if group_of(effect) == group]
        name = Column("effect", no_wrap=True)
        table = Table(name, "equation", "mechanism", "parameters", title=group, title_justify="left", expand=True)
        for effect in members:
            law = LAWS[effect.laws[0]]
            symbols = ", ".join(item.symbol for item in effect.parameters(demonstration_rig(effect), law))
            alone = "" if len(effect.rigs) > 1 else f" ({effect.rigs[0]} rigs)"
            table.add_row(effect.name, effect.equation + alone, effect.mechanism, symbols)
        console.print(table)
    console.print(f"next: python -m pneuid.effects {next(iter(CATALOGUE))}")


def _show(console: Console, effect: Effect, rig: Rig) -> None:
    console.print(f"[bold]{effect.name}[/bold] (equation {effect.equation}, {' and '.join(effect.rigs)} rigs)")
    console.print(effect.mechanism)
    for paragraph in inspect.cleandoc(effect.__doc__ or "").split("\n\n"):
        console.print(paragraph.replace("``", "").replace("\n", " "), markup=False)
    console.print(f"enters at: {', '.join(effect.ports)}")
    declared = effect.parameters(rig, LAWS[effect.laws[0]])
    table = Table(
        "parameter", "symbol", "unit", "lower", "upper", "off", "step / start", title=f"on a {rig.kind} rig, bore 32 mm"
    )
    for item in declared:
        unit, factor = handy(item.unit)
        off = "shape" if item.off is None else f"{factor * item.off:.4g}"
        lower, upper, size = (f"{factor * value:.3g}" for value in (item.lower, item.upper, item.step_or_start))
        table.add_row(item.name, item.symbol, unit, lower, upper, off, size)
    console.print(table)
    console.print("step / start: of an amplitude, how far from off the search counts; of a shape, where its fit starts")
    if any(item.off is None for item in declared):
        console.print("shape: it says how the effect acts, not how much, and means nothing while the others are off")
    for item in declared:
        if item.source != effect.reference:
            console.print(f"{item.name} after {item.source}", markup=False)
    for state in effect.states:
        console.print(f"state {state.name} ({state.unit})", markup=False)
    console.print(f"revealed by: {effect.experiment}")
    console.print(f"easily confused with: {', '.join(easily_confused(effect)) or 'none'}")
    console.print(f"guarantees: {', '.join(effect.guarantees) or 'none'}")
    console.print(f"source: {effect.reference}", markup=False)


if __name__ == "__main__":
    run_command(main)
