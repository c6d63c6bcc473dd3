"""What comes out: report.html, figures with their tables, and summary.json, whole or not at all."""

from __future__ import annotations

from pathlib import Path

from tactuator.files.atomic import atomic_folder
from tactuator.study.pages import report_page
from tactuator.study.plates import plates
from tactuator.study.run import Study
from tactuator.study.summary import summary_text

OWN_NAMES = frozenset({"report.html", "figures", "summary.json"})
"""What the folder holds."""


def publish(study: Study, folder: Path) -> None:
    """Write everything into `folder`, which must be ours to replace (see `files.atomic.require_folder`)."""
    drawn = plates(study)
    with atomic_folder(folder) as beside:
        (beside / "figures").mkdir()
        for plate in drawn:
            plate.save(beside / "figures")
        (beside / "report.html").write_text(report_page(study, drawn), encoding="utf-8")
        (beside / "summary.json").write_text(summary_text(study), encoding="utf-8")
