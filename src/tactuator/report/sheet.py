"""The sheet of a visit that a clinician signs: one page to be printed, in the study's language."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from tactuator.experiment.language.words import Words

_STYLE = """@page { size: A4; margin: 16mm }
body { font: 15px/1.4 system-ui, sans-serif; color: #1b1f24; background: #fff; max-width: 46em; margin: 1.5em auto;
  padding: 0 1em; overflow-wrap: anywhere }
h1 { font-size: 1.4em } h2 { font-size: 1.1em; margin: 1.2em 0 .3em }
dl { display: grid; grid-template-columns: minmax(8em, max-content) 1fr; gap: .1em 1em; margin: 0 }
dt { color: #565f6b }
dd { margin: 0 } .wide { overflow-x: auto } table { border-collapse: collapse; width: 100%; overflow-wrap: normal }
th, td { border-bottom: 1px solid #c9d0d8; padding: .25em .5em; text-align: right; vertical-align: top }
th:first-child, td:first-child, td:last-child { text-align: left }
.note { border: 2px solid #b03a00; padding: .4em .8em }
.sign { display: flex; flex-wrap: wrap; gap: 2em; margin-top: 3em }
.sign div { flex: 1 1 12em; border-top: 1px solid #1b1f24; padding-top: .2em }"""


@dataclass(frozen=True)
class SheetRow:
    """A threshold as the sheet has it, every cell in words: interval: open where it was not reached; z: "" without a
    norm."""

    finger: str
    frequency: str
    level: str
    interval: str
    z: str
    norm: str
    flags: str


def sheet_html(
    words: Words,
    about: Sequence[tuple[str, str]],
    rows: Sequence[SheetRow],
    unmet: Sequence[str],
    source: str,
    simulated: bool,
) -> str:
    """Return the page. about: key of the table [sheet] of the language file, and what stands there. unmet: conditions.
    source: of the norm, "" without one. simulated: nobody felt the stimuli.
    """

    def say(key: str) -> str:
        return escape(words(f"sheet.{key}"))

    listed = "".join(f"<dt>{say(key)}</dt><dd>{escape(value) or '–'}</dd>" for key, value in about)
    heads = ("finger", "frequency", "threshold", "interval", "z", "norm", "flags")
    head = "".join(f'<th scope="col">{say(name)}</th>' for name in heads)
    cells = ["".join(f"<td>{escape(cell) or '–'}</td>" for cell in vars(row).values()) for row in rows]
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    conditions = "".join(f"<li>{escape(condition)}</li>" for condition in unmet)
    norm = f"{say('norm_source')}: {escape(source)}" if source else say("no_norm")
    signed = "".join(f"<div>{say(key)}</div>" for key in ("place_date", "name", "signature"))
    return f"""<!doctype html>
<html lang="{escape(words.language)}"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{say("title")}</title><style>{_STYLE}</style></head>
<body><main><h1>{say("title")}</h1>
{f'<p class="note" role="note">{say("simulated")}</p>' if simulated else ""}
<dl>{listed}</dl>
<h2>{say("thresholds")}</h2>
<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>
<p>{say("explained")}</p><p>{norm}</p>
<h2>{say("unmet")}</h2>
{f"<ul>{conditions}</ul>" if conditions else f"<p>{say('none')}</p>"}
<div class="sign">{signed}</div></main></body></html>
"""
