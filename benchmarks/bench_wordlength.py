"""Word length of the paper's controller at 64 kHz, beside the same loops stepped in plain Python.

The peer steps each format's loop, and the loop in double precision that it is compared with, sample by sample.
"""

from __future__ import annotations

from paper_loop import paper_controller, paper_display
from timing import in_turn

from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.wordlength.assessment import assess, holds
from tactuator.wordlength.bits import at_rate
from tactuator.wordlength.formats import FORMATS
from tactuator.wordlength.roundoff import double_step, roundoff_reference, run_loop

RATE_HZ = 64_000.0


def peer(controller: Controller) -> None:
    channel, display = controller.display.channels[0], controller.display
    reference, _, _ = roundoff_reference(display.rate_hz, 30.0)
    for each in FORMATS:
        try:
            written = each.write(controller, 0)
        except BadInput:
            continue
        if holds(controller, 0, written):
            for step in (written.start(), double_step(written.prefilter, written.feedback)):
                run_loop(channel, display, step, reference)


def run() -> dict[str, object]:
    made = at_rate(paper_controller(paper_display()), RATE_HZ)
    on_boards = [each for each in FORMATS if each.loads]
    spent = in_turn(
        {"own": lambda: assess(made), "boards": lambda: assess(made, on_boards), "python": lambda: peer(made)}, 2
    )
    return {
        "all_formats_s": spent["own"],
        "formats_of_boards_s": spent["boards"],
        "stepped_in_python_s": spent["python"],
        "over_peer": spent["own"] / spent["python"],
        "goal_s": 1.0,
    }
