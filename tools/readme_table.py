"""Write README's picture, first sentence and table anew from a run with the default seed: `make readme`."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

from tactuator.api.parameters import paper_display
from tactuator.api.speech import speech_source
from tactuator.paper.measured import LOADED, UNLOADED, worst_error_db
from tactuator.paper.plan import LEVELS_DB_SL, Plan
from tactuator.paper.report import figures
from tactuator.paper.study import run_study
from tactuator.paper.summary import HEADS, comparison, upper_db

README = Path(__file__).resolve().parent.parent / "README.md"
PICTURES = {"fig02": "equality.svg", "fig10": "felt-touched.svg"}
MARK = "<!-- paper-here -->"
SENTENCE = "<!-- measured -->"


def main():
    """Replace the picture, and what stands between the marks."""
    with TemporaryDirectory() as folder:
        study = run_study(Plan(paper_display()), Path(folder), speech_source(None), lambda step, done: None)
    for figure in figures(study):
        if figure.name in PICTURES:
            (README.parent / "docs" / "figures" / PICTURES[figure.name]).write_text(figure.svg(), encoding="utf-8")
    rows = "".join(f"| {' | '.join(row)} |\n" for row in comparison(study))
    table = f"{MARK}\n| {' | '.join(HEADS)} |\n|---|---|---|---|\n{rows}{MARK}"
    text = README.read_text(encoding="utf-8")
    text = re.sub(f"{MARK}.*{MARK}", lambda _: table, text, flags=re.DOTALL)
    text = re.sub(f"{SENTENCE}.*{SENTENCE}", lambda _: sentence(study.responses), text, flags=re.DOTALL)
    README.write_text(text, encoding="utf-8")


def sentence(responses):
    """Return the largest level errors of the product's default, for README's first sentence."""
    all_levels, from_30 = (
        max(worst_error_db(responses, load, level) for load in (UNLOADED, LOADED) for level in LEVELS_DB_SL[first:])
        for first in (1, 2)
    )
    words = f"within {upper_db(all_levels)} dB from 10 dB SL up, and within {upper_db(from_30)} dB from 30 dB SL up"
    return f"{SENTENCE}{words}{SENTENCE}"


if __name__ == "__main__":
    main()
