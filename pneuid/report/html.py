"""A report is sections of paragraphs, tables and pictures; one self-contained HTML file comes of it.

All text is escaped here and nowhere else, so no other module writes HTML. Pictures stand in the file as SVG in data
addresses: nothing is fetched, identifiers of two pictures cannot meet, and a browser runs nothing inside them.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from html import escape
from importlib import metadata
from pathlib import Path
from typing import Literal

from matplotlib.figure import Figure

from pneuid.ahead import in_turn
from pneuid.report.style import ACCEPTED, REJECTED, svg


@dataclass(frozen=True)
class Paragraph:
    """Plain text; ``kind`` good, warning or note gives it a coloured edge."""

    text: str
    kind: Literal["text", "good", "warning", "note"] = "text"


@dataclass(frozen=True)
class Items:
    """A list of plain sentences."""

    texts: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """Cells of plain text; rows of ``faint`` are set back.

    align : one letter per column: l left, n left and kept on one line, r right and kept on one line.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    align: str
    caption: str = ""
    faint: frozenset[int] = field(default=frozenset())


@dataclass(frozen=True)
class Picture:
    """A figure; ``alt`` says in words what it shows."""

    figure: Figure
    alt: str
    caption: str = ""

    @cached_property
    def drawn(self) -> bytes:
        """The figure as SVG, drawn once for the page and for its own file."""
        return svg(self.figure)


Part = Paragraph | Items | Table | Picture


@dataclass(frozen=True)
class Section:
    """One heading and what stands under it."""

    heading: str
    parts: tuple[Part, ...]


def write_report(path: str | Path, title: str, sections: Sequence[Section]) -> None:
    """Write the report, whole or not at all, and its pictures as files of their own into ``figures`` beside it."""
    target = Path(path)
    folder = target.parent / "figures"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("[0-9][0-9]_*.svg"):
        old.unlink()
    pictures = [part for section in sections for part in section.parts if isinstance(part, Picture)]
    every = zip(pictures, in_turn([partial(svg, picture.figure) for picture in pictures]), strict=True)
    for number, (picture, drawn) in enumerate(every, 1):
        vars(picture)["drawn"] = drawn  # what the property would find, drawn beside others
        words = re.sub(r"[^a-z0-9]+", "_", picture.alt.lower()).strip("_")
        (folder / f"{number:02d}_{words[:48].rstrip('_')}.svg").write_bytes(drawn)
    part = target.with_name(target.name + ".part")
    # a file name need not be valid text
    part.write_text(page(title, sections), encoding="utf-8", errors="replace")
    part.replace(target)


def page(title: str, sections: Sequence[Section]) -> str:
    """The whole page as text."""
    links = "".join(f'<a href="#s{k}">{escape(item.heading)}</a>' for k, item in enumerate(sections))
    body = "".join(_section(item, k) for k, item in enumerate(sections))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_CSS}</style></head>\n"
        f'<body><main><h1>{escape(title)}</h1><nav aria-label="Sections">{links}</nav>\n{body}'
        f"<footer>{escape(_version())}Pressures are gauge, in kPa, unless a unit says otherwise; "
        "x grows as the rod extends; chamber 1 is the cap side.</footer></main></body></html>\n"
    )


def _version() -> str:
    try:
        return f"Made by pneuid {metadata.version('pneuid')}. "
    except metadata.PackageNotFoundError:
        return ""


def _section(section: Section, number: int) -> str:
    inside = "\n".join(_part(part) for part in section.parts)
    return f'<section id="s{number}"><h2>{escape(section.heading)}</h2>\n{inside}</section>\n'


def _part(part: Part) -> str:
    if isinstance(part, Paragraph):
        return f'<p class="{part.kind}">{escape(part.text)}</p>'
    if isinstance(part, Items):
        return "<ul>" + "".join(f"<li>{escape(text)}</li>" for text in part.texts) + "</ul>"
    if isinstance(part, Table):
        return _table(part)
    return _picture(part)


def _table(table: Table) -> str:
    def row(cells: Sequence[str], tag: str, faint: bool = False) -> str:
        inside = "".join(
            f'<{tag} class="{side}">{escape(cell)}</{tag}>' for cell, side in zip(cells, table.align, strict=True)
        )
        return f"<tr{' class=faint' if faint else ''}>{inside}</tr>"

    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    rows = "".join(row(cells, "td", k in table.faint) for k, cells in enumerate(table.rows))
    heads = row(table.heads, "th")
    return f'<div class="wide"><table>{caption}<thead>{heads}</thead><tbody>{rows}</tbody></table></div>'


def _picture(picture: Picture) -> str:
    encoded = base64.b64encode(picture.drawn).decode("ascii")
    caption = f"<figcaption>{escape(picture.caption)}</figcaption>" if picture.caption else ""
    return f'<figure><img alt="{escape(picture.alt)}" src="data:image/svg+xml;base64,{encoded}">{caption}</figure>'


_CSS = f"""
:root {{ --ink:#1b1f24; --soft:#59636e; --line:#d8dee4; --paper:#ffffff; --panel:#f6f8fa; --link:#005a91; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink:#e6e9ed; --soft:#a3adb8; --line:#3a424b; --paper:#15191e; --panel:#1e242b; --link:#6cb8ea; }}
}}
* {{ box-sizing:border-box; }}
body {{ margin:0; background:var(--paper); color:var(--ink);
  font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif; }}
main {{ max-width:62rem; margin:0 auto; padding:1.5rem 1.25rem 3rem; }}
h1 {{ font-size:1.7rem; line-height:1.2; margin:0 0 .6rem; overflow-wrap:anywhere; }}
h2 {{ font-size:1.2rem; margin:2.2rem 0 .6rem; padding-top:.8rem; border-top:1px solid var(--line); }}
nav {{ display:flex; flex-wrap:wrap; gap:.2rem 1rem; font-size:.9rem; }}
a {{ color:var(--link); text-decoration:none; }} a:hover {{ text-decoration:underline; }}
p {{ margin:.5rem 0; max-width:48rem; overflow-wrap:anywhere; }}
p.good, p.warning, p.note {{ background:var(--panel); border-left:4px solid #0072b2; padding:.6rem .9rem; }}
p.good {{ border-left-color:{ACCEPTED}; }} p.warning {{ border-left-color:{REJECTED}; }}
ul {{ margin:.4rem 0; padding-left:1.3rem; max-width:48rem; overflow-wrap:anywhere; }}
.wide {{ overflow-x:auto; margin:.8rem 0; }}
table {{ border-collapse:collapse; font-size:.88rem; font-variant-numeric:tabular-nums; }}
caption {{ text-align:left; color:var(--soft); padding-bottom:.3rem; }}
th, td {{ padding:.28rem .8rem .28rem 0; border-bottom:1px solid var(--line); vertical-align:top; }}
th {{ font-weight:600; white-space:nowrap; }} .l, .n {{ text-align:left; }} .r {{ text-align:right; }}
.r, .n {{ white-space:nowrap; }}
tr.faint td {{ color:var(--soft); }}
figure {{ margin:1rem 0; }}
figure img {{ display:block; width:100%; height:auto; background:#fff; border:1px solid var(--line);
  border-radius:4px; }}
figcaption {{ color:var(--soft); font-size:.88rem; margin-top:.3rem; max-width:48rem; }}
footer {{ margin-top:2.5rem; padding-top:.8rem; border-top:1px solid var(--line); color:var(--soft);
  font-size:.85rem; }}
@media print {{
  :root {{ --ink:#000; --soft:#444; --line:#bbb; --paper:#fff; --panel:#f6f6f6; --link:#000; }}
  body {{ font-size:10pt; }} table {{ font-size:8.5pt; }} main {{ max-width:none; padding:0; }} nav {{ display:none; }}
  h2, caption {{ break-after:avoid; }} figure, tr, p {{ break-inside:avoid; }}
  figure img {{ border:0; max-height:23cm; object-fit:contain; object-position:left top; }}
  .wide {{ overflow:visible; }} @page {{ margin:16mm; }}
}}
"""
