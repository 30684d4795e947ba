"""Writes docs/catalogue.md from the declarations of the effects: ``python docs/make_catalogue.py``."""

from __future__ import annotations

import inspect
from pathlib import Path

from pneuid.effect import Effect
from pneuid.effects import CATALOGUE, GROUPS, easily_confused, group_of
from pneuid.effects.__main__ import demonstration_rig
from pneuid.physics.friction import LAWS

PAGE = Path(__file__).with_name("catalogue.md")
PICTURES = PAGE.parent / "figures" / "catalogue"

_HEAD = """# The catalogue of physical effects

Written by `python docs/make_catalogue.py` from the effects' own declarations; do not edit. Numbers are those of the
demonstration rig (32 mm bore, 500 mm stroke). An amplitude is switched off at its off-value; a *shape* means nothing while
the amplitudes are off. *Step / start*: of an amplitude, how far from off the search counts; of a shape, where its fit starts
on this rig. What real machines have stands in the text, after *Typical*. *Equation* is the first one that an effect enters.
What is called `law:...` among the easily confused is a step of [the friction law](explanation/model.md#friction), no entry
of the catalogue.
Pictures: the base model beside the model with the effect at its typical size, in the experiment that shows it most, and the
difference; the grey band is what the sensors hide. `python -m pneuid.effects NAME --out DIR` draws one larger,
`python docs/make_figures.py --catalogue` all of them.
"""


def page() -> str:
    """The whole page."""
    parts = [_HEAD]
    for group in GROUPS:
        members = [effect for effect in CATALOGUE.values() if group_of(effect) == group]
        parts += [f"## {group.capitalize()}\n", *(_section(effect) for effect in members)]
    return "\n".join(parts)


def _section(effect: Effect) -> str:
    rows = ["| parameter | symbol | unit | bounds | off | step / start |", "| --- | --- | --- | --- | --- | --- |"]
    for item in effect.parameters(demonstration_rig(effect), LAWS[effect.laws[0]]):
        off = "shape" if item.off is None else f"{item.off:.3g}"
        bounds = f"{item.lower:.3g} .. {item.upper:.3g}"
        rows.append(f"| `{item.name}` | {item.symbol} | `{item.unit}` | {bounds} | {off} | {item.step_or_start:.3g} |")
    picture = PICTURES / f"{effect.name}.png"
    shown = f"![Signature of {effect.name}]({picture.relative_to(PAGE.parent).as_posix()})\n" if picture.exists() else ""
    confused = ", ".join(f"`{name}`" for name in easily_confused(effect)) or "none"
    words = " ".join(inspect.cleandoc(effect.__doc__ or "").replace("``", "`").split())
    return "\n".join([
        f"### `{effect.name}`\n", f"{effect.mechanism[0].upper()}{effect.mechanism[1:]}. {words}\n", *rows, "",
        *filter(None, [shown]),
        f"Equation `{effect.equation}`, {' and '.join(effect.rigs)} rigs. Revealed by: {effect.experiment}.",
        f"Easily confused with: {confused}. Source: {effect.reference}.\n",
    ])  # fmt: skip


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
