"""Write README's picture and its table "paper / here" anew from a run with the default seed: `make readme`."""

import re
from pathlib import Path

from tactuator.paper.plan import Plan, paper_display
from tactuator.paper.publication.comparison import comparison, markdown
from tactuator.paper.publication.plates import plates
from tactuator.paper.run import run_study
from tactuator.paper.speech import check_speech

README = Path(__file__).resolve().parent.parent / "README.md"
PICTURE = README.parent / "docs" / "figures" / "equality.svg"
MARK = "<!-- paper-here -->"


def main():
    """Replace the picture, and what stands between the marks."""
    plan = Plan(paper_display())
    study = run_study(plan, check_speech(plan), lambda step, done: None)
    picture = next(plate for plate in plates(study) if plate.name == "fig02")
    PICTURE.parent.mkdir(exist_ok=True)
    PICTURE.write_text(picture.svg(), encoding="utf-8")
    table = f"{MARK}\n{markdown(comparison(study))}{MARK}"
    text = README.read_text(encoding="utf-8")
    README.write_text(re.sub(f"{MARK}.*{MARK}", lambda _: table, text, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
