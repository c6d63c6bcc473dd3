"""docs/display.md lists every key of a display file, and no other."""

import re
from pathlib import Path

from tactuator.io.display_schema import (
    SHARED_TABLES,
    ChannelOwnKeys,
    DisplayKeys,
    ObjectivesKeys,
    SoundKeys,
    TouchKeys,
    WireKeys,
)

SOUND = {**SoundKeys.model_fields, **WireKeys.model_fields}
TABLES = {
    "display": DisplayKeys,
    "channel": ChannelOwnKeys,
    "objectives": ObjectivesKeys,
    "touch": TouchKeys,
    **SHARED_TABLES,
}


def documented() -> dict[str, set[str]]:
    text = (Path(__file__).parents[2] / "docs" / "display.md").read_text()
    found: dict[str, set[str]] = {}
    for section in text.split("\n## ")[1:]:
        name = re.match(r"`\[+(\w+)\]+`", section)
        assert name is not None
        rows = re.findall(r"^\| (`.+?) \|", section, flags=re.MULTILINE)
        found[name[1]] = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    return found


def test_display_page__every_table__lists_exactly_its_keys() -> None:
    assert documented() == {name: set(model.model_fields) for name, model in TABLES.items()} | {"sound": set(SOUND)}
