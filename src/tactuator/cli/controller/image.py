"""The verb `image`: the content of an image file, and the core's verdict on it."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.io.formats.text import read_content
from tactuator.runtime.image import REASONS, ImageHeader, ImageRefusal, check_image, read_image_header


def run(file: Path, controller: Path | None, as_json: bool) -> None:
    """Say what an image is, once the core has checked all of it; exit status 1 if it is another controller's."""
    content = _read(file)
    try:
        header = read_image_header(content)
    except BadInput as error:
        raise error.within(f"{file}") from None
    result: dict[str, object] = {
        "image": str(file),
        "bytes": len(content),
        "format": header.format,
        "rate_hz": header.rate_hz,
        "delay_samples": header.delay_samples,
        "channels": header.channels,
        "controller": header.controller_hash,
        "crc32": f"{header.crc:08x}",
    }
    if controller is not None:
        result["is_of_controller"] = _is_of(controller, content, header.controller_hash, file)
    rows = image_rows(len(content), header)
    if controller is not None:
        rows[f"made from {controller}"] = "yes" if result["is_of_controller"] else "no"
    answer(result, as_json, image_table(rows))
    if result.get("is_of_controller") is False:
        raise typer.Exit(1)


def _is_of(path: Path, content: bytes, written: str, file: Path) -> bool:
    """Return whether the image was built from that controller. Raises BadInput if the display it is for could not run
    it.
    """
    made = read_controller(path)
    refusal = check_image(content, made.rate_hz, made.delay_samples, len(made.channels))
    if refusal is not ImageRefusal.GOOD:
        raise BadInput(f"{file}: image: {REASONS[refusal]}")
    return made.content_hash == written


def _read(file: Path) -> bytes:
    try:
        return read_content(file)
    except BadInput as error:
        raise BadInput(f"image {file}: {error}", "a file that `build` wrote") from None


def image_rows(size: int, header: ImageHeader) -> dict[str, str]:
    """Return what a person reads of an image of `size` bytes."""
    return {
        "size (bytes)": str(size),
        "number format": header.format,
        "sampling rate (Hz)": f"{header.rate_hz:g}",
        "computing delay (samples)": str(header.delay_samples),
        "channels": str(header.channels),
        "hash of the controller": header.controller_hash,
        "checksum (CRC-32)": f"{header.crc:08x}",
    }


def image_table(rows: dict[str, str]) -> Table:
    """Return the table that `build` and `image` show."""
    table = Table("what", "value", title="Image")
    for row in rows.items():
        table.add_row(*row)
    return table
