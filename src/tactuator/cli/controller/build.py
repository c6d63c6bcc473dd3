"""The verb `build`: a controller as an image for a board."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group

from tactuator.cli.answer import answer, working, written
from tactuator.cli.controller.image import image_rows, image_table
from tactuator.io.atomic import atomic_path
from tactuator.io.controller import read_controller
from tactuator.runtime.image import read_image_header
from tactuator.wordlength.assessment import built


def run(controller: Path, out: Path, number_format: str, as_json: bool) -> None:
    """Write a controller as the image that a board loads; a format that is not safe for it is refused."""
    made = read_controller(controller)
    with atomic_path(out) as beside:  # first, so that a folder that is not there is told at once
        with working("comparing the number format with double precision"):
            image, report = built(made, number_format)
        header = read_image_header(image)
        beside.write_bytes(image)
    result = {
        "image": str(out),
        "bytes": len(image),
        "format": header.format,
        "rate_hz": header.rate_hz,
        "channels": header.channels,
        "controller": header.controller_hash,
        "crc32": f"{header.crc:08x}",
        "response_error_db": report.response_error_db,
    }
    rows = image_rows(len(image), header) | {"greatest error of |H| (dB)": f"{report.response_error_db:.1g}"}
    answer(result, as_json, Group(image_table(rows), *written(out)))
