"""The verdict on the objectives and on building an image, as one."""

from __future__ import annotations

from dataclasses import replace

from tactuator.display.controller import Controller
from tactuator.display.description import Display
from tactuator.display.verdict import Verdict, verdict_of
from tactuator.synthesis.verdict import judge
from tactuator.wordlength.buildable import buildable


def whole_verdict(controller: Controller, display: Display | None = None) -> Verdict:
    """Return the verdict on the objectives and on building an image, for `display` (None: the controller's own)."""
    judged = judge(controller, display)
    shown = controller if display is None else replace(controller, display=display)
    findings = [finding for objective in judged.objectives for finding in objective.findings]
    return verdict_of([*findings, buildable(shown)], judged.assumptions)
