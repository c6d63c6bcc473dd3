"""A self-contained page: sections of text, tables and plates, with everything it shows inside it."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from tactuator.report.plate import Plate

_STYLE = """
:root { color-scheme: light; --ink: #222; --faint: #666; --line: #ddd; --blue: #0072b2; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: #fff; margin: 0 auto; max-width: 52rem;
       padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid var(--line);
     padding-top: 1rem; font-size: 1.25rem; }
nav ol { columns: 2; font-size: .92rem; } nav a, p a { color: var(--blue); }
figure { margin: 1.2rem 0; overflow-x: auto; } figure img { width: 100%; min-width: 34rem; height: auto; }
figcaption { color: var(--faint); font-size: .9rem; }
.table { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; margin: .8rem 0; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top;
         font-variant-numeric: tabular-nums; }
.met { color: #007a5a; font-weight: 600; } .not-met { color: #b03a00; font-weight: 600; }
footer { margin-top: 3rem; color: var(--faint); font-size: .85rem; }
@media (max-width: 40rem) { nav ol { columns: 1; } }
"""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a header; a cell `met` or `not met` is coloured."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def html(self) -> str:
        """Return the table as HTML."""
        head = "".join(f"<th scope='col'>{escape(cell)}</th>" for cell in self.header)
        body = "".join(f"<tr>{''.join(_cell(cell) for cell in row)}</tr>" for row in self.rows)
        return f"<div class='table'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs (plain text), tables and plates, in this order."""

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    plates: Sequence[Plate] = ()


def page(title: str, introduction: Sequence[str], sections: Sequence[Section], footer: str) -> str:
    """Return the page as one HTML file without links to anywhere else."""
    contents = "".join(
        f"<li><a href='#{_anchor(section.title)}'>{escape(section.title)}</a></li>" for section in sections
    )
    body = "".join(_section(section) for section in sections)
    lead = "".join(f"<p>{escape(text)}</p>" for text in introduction)
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>"
        f"<header><h1>{escape(title)}</h1>{lead}</header><nav aria-label='Contents'><ol>{contents}</ol></nav>"
        f"<main>{body}</main><footer>{escape(footer)}</footer></body></html>\n"
    )


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    parts += [f"<p>{escape(text)}</p>" for text in section.paragraphs]
    parts += [table.html() for table in section.tables]
    parts += [_figure(plate) for plate in section.plates]
    return f"<section id='{_anchor(section.title)}'>{''.join(parts)}</section>"


def _figure(plate: Plate) -> str:
    picture = base64.b64encode(plate.svg().encode()).decode()
    number = plate.name.removeprefix("fig").lstrip("0")
    label = f"Figure {number}. " if number.isdigit() else ""
    return (
        f"<figure id='{escape(plate.name)}'><img alt='{escape(plate.title)}' "
        f"src='data:image/svg+xml;base64,{picture}'>"
        f"<figcaption><b>{label}{escape(plate.title)}.</b> {escape(plate.caption)}</figcaption></figure>"
    )


def _cell(cell: str) -> str:
    kind: Mapping[str, str] = {"met": " class='met'", "not met": " class='not-met'"}
    return f"<td{kind.get(cell, '')}>{escape(cell)}</td>"


def _anchor(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
