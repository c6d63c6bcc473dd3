"""Columns of numbers out of text: any delimiter and decimal mark, in pieces, cut off within a number or not."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.io import columns
from tactuator.io.columns import last_number_cut_off, read_columns, read_table

FORMS = ("{!r}", "{:.17g}", "{:.3e}", "{:.6f}", "{:+.4f}", "{:E}", " {:.12g} ")
DELIMITERS = {",": ".", ";": ",", "\t": ","}


@given(
    numbers=st.lists(st.floats(-1e12, 1e12), min_size=3, max_size=60),
    form=st.sampled_from(FORMS),
    mark=st.sampled_from(sorted(DELIMITERS)),
    end=st.sampled_from(["\n", "\r\n"]),
    piece=st.integers(10, 400),
)
def test_read_table__numbers_in_any_form__are_those_of_float(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], form: str, mark: str, end: str, piece: int
) -> None:
    rows = [numbers[k : k + 3] for k in range(0, len(numbers) // 3 * 3, 3)]
    cells = [[form.format(value) for value in row] for row in rows]
    path = tmp_path_factory.getbasetemp() / "t.csv"
    lines = ["a" + mark + "b" + mark + "c", *(mark.join(row).replace(".", DELIMITERS[mark]) for row in cells)]
    path.write_bytes(end.join(lines).encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns, "_PIECE_CHARACTERS", piece)
        names, values, cut = read_table(path, 1000, 10000)
    assert names == ["a", "b", "c"]
    assert not cut
    np.testing.assert_array_equal(values, [[float(cell) for cell in row] for row in cells])


@pytest.mark.parametrize(
    "text",
    ["1,2\n3,nan\n5,6\n", "1,2\n\n# a remark\n3,x\n5,6\n", '1,2\n"3",\n5,6\n', "1,2\n3,0x1\n5,6\n", "1,2\r3,1_0_\r5,6"],
)
def test_read_table__an_odd_row_among_numbers__is_nan_where_it_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, newline="")
    _, values, _ = read_table(path, 100, 1000)
    np.testing.assert_array_equal(values, [[1.0, 2.0], [3.0, np.nan], [5.0, 6.0]])


@pytest.mark.parametrize("text", ["1,2\n3,4\n5\n", "1,2\n3,4\n5,6,7\n", "1,2\n3,4 5\n1\n"])
def test_read_table__rows_of_several_lengths__are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match="columns"):
        read_table(path, 100, 1000)


@pytest.mark.parametrize(("most", "read", "cut"), [(9, 9, True), (10, 10, False), (11, 10, False)])
def test_read_table__limit_of_rows__is_kept_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, read: int, cut: bool
) -> None:
    path = tmp_path / "t.csv"
    path.write_text("".join(f"{k},{k}\n" for k in range(10)) + "\n\n")
    monkeypatch.setattr(columns, "_PIECE_CHARACTERS", 10)
    _, values, was_cut = read_table(path, most, 1000)
    assert (values[:, 1].tolist(), was_cut) == (list(range(read)), cut)
    _, values, was_cut = read_table(path, most, 12)
    assert (len(values), was_cut) == (6, True)


def test_read_table__plain_numbers__go_the_quick_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "t.csv").write_text("t,u\n0,1e-3\n-1.5,2E+300")
    monkeypatch.setattr(np, "loadtxt", None)
    assert read_table(tmp_path / "t.csv", 100, 1000)[1].tolist() == [[0.0, 1e-3], [-1.5, 2e300]]


def test_read_table__long_remarks_ahead__are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("# remark\n" * 5000 + "t,u\n0,1.5\n1,2.5\n")
    names, values, cut = read_table(path, 10, 100)
    assert (names, values.tolist(), cut) == (["t", "u"], [[0.0, 1.5], [1.0, 2.5]], False)
    path.write_text("# remark\n" * 100_001 + "t,u\n0,1.5\n")
    with pytest.raises(BadInput, match="remarks fill its first 100000 lines"):
        read_table(path, 10, 100)


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
    for there in range(1, len(last)):
        path.write_bytes(whole[: there - len(last)])
        assert last_number_cut_off(path) == last[:there]
    for content in (whole, whole + b"\n"):  # a whole file, without the last line's end too
        path.write_bytes(content)
        assert last_number_cut_off(path) is None


@pytest.mark.parametrize("form", ["%.17g", "%.4g", "%d", "%.1f"])
def test_last_number__whole_file_without_its_last_line_end__is_none(tmp_path: Path, form: str) -> None:
    path = written(tmp_path, form)
    lines = path.read_text().splitlines()
    for end in range(80, 400, 8):
        path.write_text("\n".join(lines[:end]))
        assert last_number_cut_off(path) is None
    path.write_text("\n".join([*lines[:end], "3.5,-0"]))
    assert last_number_cut_off(path) == ("-0" if form in ("%.17g", "%.1f") else None)


def test_read_columns__file_cut_off__last_row_is_left_out_and_told_where_rows_are_many(tmp_path: Path) -> None:
    path = written(tmp_path, "%.4f", rows=30)
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    assert last_number_cut_off(path) is None  # nothing tells
    path = written(tmp_path, "%.4f")
    path.write_bytes(path.read_bytes().rstrip()[:-2])
    columns = read_columns(path)
    assert columns.values["y"].size == 399
    (remark,) = columns.remarks
    assert "ends within its last number" in remark
