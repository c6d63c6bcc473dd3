"""The verb `sound devices`: the cards that there are."""

from __future__ import annotations

from dataclasses import asdict

from rich.console import Group
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.rig.sound.cards import list_cards


def run(as_json: bool) -> None:
    """Show the sound cards with their outputs, inputs and rates."""
    cards = list_cards()
    table = Table("card", "outputs", "inputs", "its own rate (Hz)", title="sound cards")
    for one in cards:
        table.add_row(one.full_name, str(one.outputs), str(one.inputs), f"{one.rate_hz:g}")
    hint = (
        ()
        if cards
        else ("PortAudio finds no card; `aplay -l` lists those of ALSA, and a sound server may have to run",)
    )
    answer({"devices": [asdict(one) | {"device": one.full_name} for one in cards]}, as_json, Group(table, *hint))
