"""The verdict on the objectives and on building an image, as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Verdict, verdict_of
from tactuator.synthesis.drawn_verdict import drawn_assumptions, judge_drawn
from tactuator.synthesis.monte_carlo import DrawnPlants
from tactuator.synthesis.verdict import judge
from tactuator.wordlength.buildable import buildable


def whole_verdict(controller: Controller, display: Display | None = None, drawn: Sequence[DrawnPlants] = ()) -> Verdict:
    """Return the verdict on the objectives and on building an image, for `display` (None: the controller's own), and on
    the plants `drawn` for it, if any.
    """
    judged = judge(controller, display)
    shown = controller if display is None else replace(controller, display=display)
    findings = [finding for objective in judged.objectives for finding in objective.findings]
    findings += judge_drawn(drawn, shown.display)
    return verdict_of([*findings, buildable(shown)], (*judged.assumptions, *drawn_assumptions(drawn)))
