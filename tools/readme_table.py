"""Write README's picture, first sentence and table anew from a run with the default seed: `make readme`."""

import re
from pathlib import Path

from tactuator.paper.plan import LEVELS_DB_SL, Plan, paper_display
from tactuator.paper.report import plates
from tactuator.paper.response import LOADED, UNLOADED, check_speech, worst_error_db
from tactuator.paper.run import run_study
from tactuator.paper.summary import comparison, markdown

README = Path(__file__).resolve().parent.parent / "README.md"
PICTURE = README.parent / "docs" / "figures" / "equality.svg"
MARK = "<!-- paper-here -->"
SENTENCE = "<!-- measured -->"


def main():
    """Replace the picture, and what stands between the marks."""
    plan = Plan(paper_display())
    study = run_study(plan, check_speech(plan), lambda step, done: None)
    picture = next(plate for plate in plates(study) if plate.name == "fig02")
    PICTURE.parent.mkdir(exist_ok=True)
    PICTURE.write_text(picture.svg(), encoding="utf-8")
    table = f"{MARK}\n{markdown(comparison(study))}{MARK}"
    text = README.read_text(encoding="utf-8")
    text = re.sub(f"{MARK}.*{MARK}", lambda _: table, text, flags=re.DOTALL)
    text = re.sub(f"{SENTENCE}.*{SENTENCE}", lambda _: sentence(study.responses), text, flags=re.DOTALL)
    README.write_text(text, encoding="utf-8")


def sentence(responses):
    """Return the largest errors of the responses above threshold, for README's first sentence."""
    free, touched = (
        max(worst_error_db(responses, load, level) for level in LEVELS_DB_SL if level > 0.0)
        for load in (UNLOADED, LOADED)
    )
    return f"{SENTENCE}within {free:.2f} dB unloaded, and within {touched:.2f} dB under a resting finger{SENTENCE}"


if __name__ == "__main__":
    main()
