"""The verb `finger`: mass, damping and stiffness of what touches a display."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer, working
from tactuator.cli.chosen import ask_for_load, chosen_controller
from tactuator.measure.finger import CANNOT_TELL, CHAIN, NEITHER, ONE, FingerEstimate, measure_finger
from tactuator.rig.finger import touch_all, usual_load
from tactuator.rig.open import open_rig

_SAYS = {
    ONE: "one mass, damper, spring",
    CHAIN: "not by one: a chain of two is nearer",
    NEITHER: "neither by one nor by a chain of two",
    CANNOT_TELL: "cannot tell: play longer or louder",
}


_CUT = "cannot tell: the reading came to its end; play more quietly"


def run(
    display: Path | None,
    controller: Path | None,
    load: str | None,
    level_db_sl: float,
    duration_s: float,
    channel: list[str] | None,
    rig: str,
    seed: int,
    as_json: bool,
) -> None:
    """Play free and touched; mass, damping and stiffness of what touches, with confidence, and whether they describe
    it. Exit status 1 where they do not.
    """
    made = chosen_controller(display, controller)
    touching = load or usual_load(made.display.channels)
    with open_rig(rig, made.display, seed) as opened:

        def touch() -> None:
            ask_for_load(touch_all(opened, made.display.channels, touching), touching)

        with working("playing free, then touched"):
            found = measure_finger(
                opened, made, touch, np.random.default_rng(seed),
                channels=channel, level_db_sl=level_db_sl, seconds=duration_s,
            )  # fmt: skip
    answer({"channels": [document(one) for one in found]}, as_json, _shown(found))
    if any(one.described_by != ONE for one in found):
        raise typer.Exit(1)


def document(found: FingerEstimate) -> dict[str, Any]:
    """Return what touches one channel, as `--json` prints it."""
    return vars(found) | {"half_width": list(found.half_width), "chain": list(found.chain)}


def _shown(found: Sequence[FingerEstimate]) -> Group:
    table = Table(
        "channel", "mass", "damping", "stiffness", "misfit dB", "described by",
        caption="in the units of a load of the display file, ± 95 %; misfit: what the felt level is off by, at most, "
        "where one mass, damper and spring stands for it",
    )  # fmt: skip
    for one in found:
        figures = zip((one.mass, one.damping, one.stiffness), one.half_width, strict=True)
        cells = [f"{value:.4g} ± {half:.2g}" for value, half in figures]
        table.add_row(
            one.channel, *cells, f"{one.misfit_db:.2f}", _SAYS[one.described_by] if not one.saturated else _CUT
        )
    lines = [
        f'{one.channel}: loads = [{{ name = "finger", mass = {one.load.mass:.4g}, damping = {one.load.damping:.4g}, '
        f"stiffness = {one.load.stiffness:.4g} }}]"
        for one in found
        if one.described_by == ONE
    ]
    return Group(table, *lines)
