"""Requests that a page may make of the study at the rig, checked and bounded before they are used."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, TypeAdapter

from tactuator.console.asked import Name, PageRequest, checked_request
from tactuator.console.views.experiment import Files, StoreName


class BeginStudy(PageRequest):
    """Request to begin or resume a study. files: keys of what its protocol names. amend: why the protocol changed."""

    do: Literal["begin"]
    protocol: Name
    store: StoreName
    files: Files = ()
    auto_start: bool = False
    amend: Annotated[str, StringConstraints(max_length=400, strip_whitespace=True)] = ""


class EndStudy(PageRequest):
    """Request to end the study: nothing plays any more, its store is closed, and the rig is free."""

    do: Literal["end"]


class ExportStudy(PageRequest):
    """Request for the store's trials in an open format, as one file (ZIP), or for its curve across subjects."""

    do: Literal["export"]
    store: StoreName
    form: Name


StudyRequest = BeginStudy | EndStudy | ExportStudy
_REQUEST: TypeAdapter[StudyRequest] = TypeAdapter(Annotated[StudyRequest, Field(discriminator="do")])


def request_of(text: str) -> StudyRequest:
    """Return a request. Raises BadInput, naming the key, for anything else."""
    return checked_request(_REQUEST, text)
