"""The view Experiment, before a study is open: protocols to choose or to drop, and the stores that are there."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from tactuator.console.asked import Answer, Name, ViewRequest
from tactuator.console.drawer import Drawer
from tactuator.console.workshop import Workshop
from tactuator.errors import BadInput
from tactuator.experiment.export.export import FORMS
from tactuator.experiment.protocol.file import read_any_protocol
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.io.shipped import EXAMPLES, example_names

STORE = "lab.db"
_EXAMPLE = "example:"
StoreName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._ -]{0,100}\.db$")]
"""Name of a store in the folder of the console: a plain file name."""
Files = Annotated[tuple[Name, ...], Field(max_length=20)]


class ExperimentStart(ViewRequest):
    """Request for what a study can begin from."""

    do: Literal["experiment.start"]

    def answer(self, workshop: Workshop) -> Answer:
        """Return the protocols that come with the package, the stores of the console's folder, and export formats."""
        return {
            "protocols": [f"{_EXAMPLE}{name}" for name in _shipped()],
            "stores": sorted(path.name for path in workshop.folder.glob("*.db")),
            "store": STORE,
            "forms": list(FORMS),
        }


class ExperimentLook(ViewRequest):
    """Request for what a protocol says, before a study begins from it."""

    do: Literal["experiment.look"]
    protocol: Name

    def answer(self, workshop: Workshop) -> Answer:
        """Return name, kind, language and subjects of the study. Raises BadInput, naming the key, for no protocol."""
        read, _ = read_any_protocol(protocol_path(workshop.drawer, self.protocol))
        items = [item.file for item in read.item] if isinstance(read, RecognitionProtocol) else []
        own = read.study.language_file
        return {
            "study": read.study.name,
            "kind": "recognition" if isinstance(read, RecognitionProtocol) else "detection",
            "language": read.study.language,
            "subjects": [subject.code for subject in read.subject],
            "files": [*items, *([] if own is None else [own])],
        }


ExperimentRequest = ExperimentStart | ExperimentLook


def protocol_path(drawer: Drawer, key: str) -> Path:
    """Return the protocol file of a key: one that was dropped, or an example. Raises BadInput for one that is none."""
    name = key.removeprefix(_EXAMPLE)
    return EXAMPLES / name if key.startswith(_EXAMPLE) and name in _shipped() else drawer.path(key)


def _shipped() -> list[str]:
    """Return the protocols that come with the package, relative to the folder of examples."""
    toml = [name for name in example_names() if name.endswith(".toml")]
    return [name for name in toml if name == "protocol.toml" or name.startswith("protocols/")]


def together(drawer: Drawer, protocol: str, files: tuple[str, ...]) -> Path:
    """Return a protocol in a folder with the files that were dropped for it; an example stays where its files are."""
    path = protocol_path(drawer, protocol)
    if protocol.startswith(_EXAMPLE):
        return path
    _, place = drawer.place()
    for one in (path, *(drawer.path(key) for key in files)):
        if (place / one.name).exists():
            raise BadInput(f"two files named {one.name}", "one of each name")
        shutil.copyfile(one, place / one.name)
    return place / path.name
