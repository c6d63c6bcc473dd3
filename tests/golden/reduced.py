"""What a command gave, as one flat table of keys: JSON, text and files, with long columns reduced to a few numbers."""

from __future__ import annotations

import csv
import json
import re
import sqlite3
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import soundfile

Flat = dict[str, Any]
SHORT = 6
"""A list of more values than this is a series: its length, mean, rms, least, greatest, and five values of it."""
NAMES = ("name", "code", "quantity", "what", "label", "subject", "key", "hertz", "frequency_hz")
"""Keys by which the entries of a list of tables are called, where they differ in it."""
LINES = 160
VOLATILE = [
    (re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:?\d\d)?)?"), "DATE"),
    (re.compile(r"\b[0-9a-f]{64}\b"), "HASH"),
    (re.compile(r"/s/[\w-]{16,}"), "/s/TOKEN"),
    (re.compile(r"(?<=tactuator )\d+\.\d+\.\d+\S*|^\d+\.\d+\.\d+(\.dev\S*|\+\S*)?$"), "VERSION"),
]
"""What differs from run to run, or with everything that is hashed: compared by its place alone."""


def plain(text: str) -> str:
    """The text without what differs from run to run."""
    for pattern, word in VOLATILE:
        text = pattern.sub(word, text)
    return text


def lines(text: str) -> list[str]:
    """The lines of a text without frames and with single spaces; of a long one the first and a checksum."""
    kept = [
        " ".join(plain(line).translate(dict.fromkeys(map(ord, "─│┃━┏┓┗┛╭╮╰╯"), " ")).split())
        for line in text.split("\n")
    ]
    kept = [line for line in kept if line]
    rest = kept[LINES:]
    return (
        [*kept[:LINES], f"and {len(rest)} lines more, {zlib.crc32(chr(10).join(rest).encode()):08x}"] if rest else kept
    )


def rounded(value: float) -> float | str:
    return float(f"{value:.9g}") if np.isfinite(value) else str(value)


def series(values: list[Any] | np.ndarray) -> Flat:
    """A long column of numbers (or of texts) as a few numbers."""
    if any(isinstance(value, str) for value in values):
        texts = [plain(str(value)) for value in values]
        kinds = Counter(texts)
        if len(kinds) <= 2 * SHORT:
            return {"of": len(texts), **{f"'{kind}'": count for kind, count in sorted(kinds.items())}}
        return {
            "of": len(texts),
            "first": texts[0],
            "last": texts[-1],
            "crc": f"{zlib.crc32(chr(10).join(texts).encode()):08x}",
        }
    given = np.array([np.nan if value is None else value for value in np.ravel(values)], dtype=float)
    there = given[np.isfinite(given)]
    found: Flat = {"of": given.size} | ({"empty": given.size - there.size} if there.size < given.size else {})
    if there.size:
        at = there[np.linspace(0, there.size - 1, 5).astype(int)]
        figures = np.mean(there), np.sqrt(np.mean(there**2)), there.min(), there.max()
        found |= dict(zip(("mean", "rms", "least", "greatest"), map(rounded, figures), strict=True))
        found["at"] = [rounded(value) for value in at]
    return found


def flatten(value: Any, key: str, into: Flat) -> None:
    """Put a value of JSON into the table, under keys that say its place."""
    if isinstance(value, dict):
        for name, part in value.items():
            flatten(part, f"{key}.{plain(str(name))}", into)
    elif isinstance(value, list | tuple) and value and all(isinstance(part, dict) for part in value):
        names = next((n for n in NAMES if len({str(part[n]) for part in value if n in part}) == len(value)), None)
        if len(value) > (1 if names in (None, *NAMES[-2:]) else 50):
            into[f"{key}.length"] = len(value)
            for column in dict.fromkeys(name for part in value for name in part):
                flatten([part.get(column) for part in value], f"{key}[].{column}", into)
        else:
            for index, part in enumerate(value):
                flatten(part, f"{key}[{part[names] if names else index}]", into)
    elif isinstance(value, list | tuple):
        if any(isinstance(part, list | tuple | dict) for part in value):
            for index, part in enumerate(value[: 2 * SHORT]):
                flatten(part, f"{key}[{index}]", into)
            if len(value) > 2 * SHORT:
                into[f"{key}.length"] = len(value)
        else:
            flat = list(value)
            into[key] = series(flat) if len(flat) > SHORT else [rounded_if(part) for part in flat]
    else:
        into[key] = rounded_if(value)


def rounded_if(value: Any) -> Any:
    if isinstance(value, bool | int) or value is None:
        return value
    if isinstance(value, float | np.floating):
        return rounded(float(value))
    text = plain(str(value))
    return text if len(text) < 400 else f"{text[:80]}… {len(text)} letters, {zlib.crc32(text.encode()):08x}"


def table(text: str, separator: str) -> Flat:
    """The columns of a CSV, and the lines of its head."""
    into: Flat = {}
    head = [line for line in text.splitlines() if line.startswith("#")]
    names, *rows = csv.reader(
        [line for line in text.splitlines() if not line.startswith("#")], delimiter=separator
    ) or [[]]
    into["head"], into["columns"] = [plain(line) for line in head], names
    for place, name in enumerate(names):
        flatten([number(row[place]) if place < len(row) else None for row in rows], name, into)
    return into


def number(text: str) -> float | str | None:
    try:
        return float(text) if text else None
    except ValueError:
        return text


def stored(path: Path) -> Flat:
    """The datasets and attributes of an HDF5 file."""
    into: Flat = {}

    def visit(name: str, item: Any) -> None:
        for key, value in sorted(item.attrs.items()):
            flatten(value.tolist() if hasattr(value, "tolist") else value, f"{name}@{key}", into)
        if isinstance(item, h5py.Dataset):
            values = item[()] if item.shape == () or item.dtype.kind not in "OS" else item.asstr()[()]
            columns = (
                np.reshape(values, (len(values), -1)).T.tolist()
                if np.ndim(values) > 1
                else [np.atleast_1d(values).tolist()]
            )
            for place, column in enumerate(columns[: 2 * SHORT]):
                flatten([abs(v) if isinstance(v, complex) else v for v in column], f"{name}[{place}]", into)

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return into


def tables(path: Path) -> Flat:
    """The tables of a store: their columns and how many rows they have."""
    with sqlite3.connect(path) as base:
        names = [name for (name,) in base.execute("select name from sqlite_master where type = 'table' order by name")]
        columns = {name: [row[1] for row in base.execute(f"pragma table_info({name})")] for name in names}
        rows = {name: base.execute(f"select count(*) from {name}").fetchone()[0] for name in names}
    return {name: [rows[name], " ".join(columns[name])] for name in names}


def file(path: Path) -> Flat:
    """What a file says."""
    into: Flat = {}
    match path.suffix:
        case ".json":
            flatten(json.loads(path.read_text(encoding="utf-8")), "", into)
        case ".csv" | ".tsv":
            into = table(path.read_text(encoding="utf-8"), "," if path.suffix == ".csv" else "\t")
        case ".h5":
            into = stored(path)
        case ".db":
            into = tables(path)
        case ".wav" | ".flac":
            samples, rate_hz = soundfile.read(path, always_2d=True)
            into = {f"[{place}]": series(column) for place, column in enumerate(samples.T[: 2 * SHORT])}
            into |= {"rate_hz": rate_hz, "bits": f"{zlib.crc32(samples.tobytes()):08x}"}
        case ".svg":  # every text that is drawn stands there as a comment
            into["texts"] = sorted(set(re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8"))))
        case ".html":
            drawn = re.sub(r"(?s)<(svg|style|script).*?</\1>", "", path.read_text(encoding="utf-8"))
            into["text"] = lines(re.sub(r"(?s)<[^>]*>", "\n", drawn))
        case ".toml" | ".md" | ".txt" | ".bidsignore" | "":
            into["text"] = lines(path.read_text(encoding="utf-8"))
        case _:
            into = {"size": path.stat().st_size, "bits": f"{zlib.crc32(path.read_bytes()):08x}"}
    return into
