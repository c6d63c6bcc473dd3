"""The verb `init`: files to start from."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from tactuator.cli.answer import answer
from tactuator.errors import BadInput
from tactuator.io.model import read_model
from tactuator.io.start.shipped import copy_examples, write_all
from tactuator.io.start.template import (
    DISPLAY_KINDS,
    display_template,
    protocol_items,
    protocol_template,
    with_model,
)

_PROTOCOL = "protocol.toml"


def run(
    like: str | None, model: Path | None, out: Path, protocol: str | None, examples: Path | None, as_json: bool
) -> None:
    """Write a commented display file (and a protocol) to start from, or copy out the examples."""
    if examples is not None:
        if like is not None or model is not None or protocol is not None:
            raise BadInput("--examples with another option", "--examples alone, since it copies everything")
        written = [str(path) for path in copy_examples(examples)]
        said = f"{len(written)} files written into {examples}; {examples / 'README.md'} says what each is"
        answer({"written": written}, as_json, said)
        return
    contents = {out: _display(like or DISPLAY_KINDS[0], model, out).encode()}
    if protocol is not None:
        contents[out.parent / _PROTOCOL] = protocol_template(protocol).encode()
    for path in contents:
        if path.exists():
            raise BadInput(f"{path} is there already", "--out with a name that is free")
    if not out.parent.is_dir():
        raise BadInput(f"{out.parent} is not a folder", "--out in a folder that is there")
    if protocol is not None:
        contents |= {out.parent / name: content for name, content in protocol_items(protocol).items()}
    write_all(contents)
    result: dict[str, Any] = {"written": [str(path) for path in contents]}
    answer(result, as_json, "\n".join(f"written: {path}" for path in contents))


def _display(kind: str, model: Path | None, out: Path) -> str:
    """Return the text of a display file of that kind, with the model of a file as its plant if there is one."""
    text = display_template(kind)
    return text if model is None else with_model(text, read_model(model), os.path.relpath(model, out.parent))
