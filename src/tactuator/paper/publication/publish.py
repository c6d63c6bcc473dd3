"""Publication of a study: report.html, figures with their tables, and summary.json."""

from __future__ import annotations

from pathlib import Path

from tactuator.paper.publication.pages import report_page
from tactuator.paper.publication.plates import plates
from tactuator.paper.publication.summary import summary_text
from tactuator.paper.run import PaperStudy

OWN_NAMES = frozenset({"report.html", "figures", "summary.json"})
"""Names of everything that the folder holds afterwards."""


def publish(study: PaperStudy, folder: Path) -> None:
    """Write everything into `folder`, which is there and empty."""
    drawn = plates(study)
    (folder / "figures").mkdir()
    for plate in drawn:
        plate.save(folder / "figures")
    (folder / "report.html").write_text(report_page(study, drawn), encoding="utf-8")
    (folder / "summary.json").write_text(summary_text(study), encoding="utf-8")
