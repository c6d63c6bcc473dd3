"""Texts that end within a number, and whole ones that only lack the last line's end."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.io.columns import last_number_cut_off, read_columns


def written(folder: Path, form: str, delimiter: str = ",", rows: int = 400) -> Path:
    """Return a file of two columns in that form."""
    path, values = folder / "record.csv", np.random.default_rng(3).normal(0.0, 30.0, (rows, 2))
    np.savetxt(path, values, fmt=form, delimiter=delimiter, header="u,y".replace(",", delimiter), comments="")
    return path


@pytest.mark.parametrize(("form", "delimiter"), [("%.4f", ","), ("%.6e", ","), ("%.6e", "\t"), ("%.3f", ";")])
def test_last_number__file_cut_anywhere_within_it__is_found(tmp_path: Path, form: str, delimiter: str) -> None:
    path = written(tmp_path, form, delimiter)
    whole = path.read_bytes().rstrip()
    last = whole.decode().rpartition(delimiter)[2]
    for left in range(1, len(last)):
        path.write_bytes(whole[: left - len(last)])
        assert last_number_cut_off(path) == last[:left]
    path.write_bytes(whole)
    assert last_number_cut_off(path) is None  # a whole file without the last line's end
    path.write_bytes(whole + b"\n")
    assert last_number_cut_off(path) is None


@pytest.mark.parametrize("form", ["%.17g", "%.4g", "%d", "%.1f"])
def test_last_number__whole_file_without_its_last_line_end__is_none(tmp_path: Path, form: str) -> None:
    path = written(tmp_path, form)
    lines = path.read_text().splitlines()
    for end in range(80, 400):
        path.write_text("\n".join(lines[:end]))
        assert last_number_cut_off(path) is None


def test_last_number__few_rows__nothing_tells(tmp_path: Path) -> None:
    path = written(tmp_path, "%.4f", rows=30)
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    assert last_number_cut_off(path) is None


def test_read_columns__file_cut_off__last_row_is_left_out_and_told(tmp_path: Path) -> None:
    path = written(tmp_path, "%.4f")
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    columns = read_columns(path)
    assert columns.values["y"].size == 399
    (remark,) = columns.remarks
    assert "ends within its last number" in remark
