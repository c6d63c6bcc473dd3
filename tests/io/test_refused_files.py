"""Files that are not what a reader reads: each is refused in one line. Damage that was found: test_hostile_files."""

from functools import partial

import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import read_controller
from tactuator.io.csv_tables import read_contours, read_curve, read_matrix, read_pairs
from tactuator.io.model import read_model
from tactuator.io.record import read_record
from tactuator.io.response import read_responses

CONTOURS = b"level_db_sl,frequency_hz,db_sl\n"
CURVE = b"frequency_hz,level_db_re_1um\n"
TWO = CONTOURS + b"10,30,9\n10,100,10\n"
record = partial(read_record, rate_hz=10.0)


@pytest.mark.parametrize(
    ("read", "name", "content", "words"),
    [
        (read_controller, "c.json", None, "No such file or directory"),
        (read_controller, "c.json", b"{", "it is not JSON"),
        (read_controller, "c.json", b"\xff\xfe\x00", "it is not text"),
        (read_controller, "c.json", b"{}", "format is None; allowed: 'tactuator-controller/1'"),
        (read_controller, "c.json", b"[]", "format is 'list'"),
        (
            read_controller,
            "c.json",
            b'{"format": "tactuator-controller/2"}',
            "format is 'tactuator-controller/2'; allow",
        ),
        (read_model, "m.json", b"", "allowed"),
        (read_model, "m.json", b"[]", "allowed"),
        (read_model, "m.json", b'{"format": "other"}', "allowed"),
        (read_model, "m.json", b'{"format": "tactuator-model/1"}', "allowed"),
        (read_responses, "r.h5", b"no", "allowed"),
        (read_pairs, "p.csv", b"", "no column"),
        (read_pairs, "p.csv", b"displacement_mm,volts\n1,2\n", "'voltage_v'"),
        (read_pairs, "p.csv", b"displacement_mm,voltage_v\n1,x\n", "row 2 has 'x'"),
        (read_contours, "c.csv", b"", "columns nothing, 0 rows; allowed: level_db_sl, frequency_hz, db_sl"),
        (read_contours, "c.csv", CONTOURS + b"10,30,x\n", "db_sl is 'x' in a row"),
        (read_contours, "c.csv", TWO + b"20,100,20\n", "3 rows for 2 contours and 2 freq"),
        (read_contours, "c.csv", b"# name: a\n# reference_hz: x\n" + TWO, "reference_hz is x; allowed"),
        (read_contours, "c.csv", b"# name: a\n# area_mm2: x\n" + TWO, "area_mm2 is 'x'"),
        (read_contours, "c.csv", b"# name: a\n# age_years: 20\n" + TWO, "age_years"),
        (read_contours, "c.csv", b"# name: a\n# provenance: b\n" + TWO, "provenance is 'b'"),
        (read_curve, "c.csv", None, "No such file"),
        (read_curve, "c.csv", b"\xff\xfe\x00", "not text"),
        (read_curve, "c.csv", b"", "columns nothing; allowed: frequency_hz"),
        (read_curve, "c.csv", b"hz,db\n1,2\n", "columns hz, db; allowed"),
        (read_curve, "c.csv", CURVE + b"1,x\n", "level_db_re_1um is 'x' in a row; allowed: a number"),
        (read_curve, "c.csv", CURVE + b"1,2\n2\n", "allowed"),
        (read_curve, "c.csv", b"frequency_hz,acceleration_m_s2_rms\n1,2\n2,-3\n3,1\n", "not a finite number"),
        (read_matrix, "m.csv", None, "No such file"),
        (read_matrix, "m.csv", b"", "no rows"),
        (read_matrix, "m.csv", b"1,2\n3\n", "equal length"),
        (read_matrix, "m.csv", b"a,b\n", "equal length"),
        (read_matrix, "m.csv", b"1,2\n3,x\n", "not a number"),
        (record, "none.csv", None, "no such file"),
        (record, "r.csv", b"", "empty"),
        (record, "r.csv", b"t,u,y\n", "no rows"),
        (record, "r.csv", b"t,u,y\n1,2,3\n2,3\n", "row 2 has 2 of 3 columns; allowed: as many in each"),
        (
            record,
            "r.csv",
            b"Our Scope 2\nby: Anna\nt,u,y\n1,2,3\n4,5,6\n",
            "row 1 has 1 of 3 columns; allowed: '#' bef",
        ),
        (
            record,
            "r.csv",
            b"t,u,y\ns,V,V\n1,2,3\n",
            r"u is not a number in row 1 of 2; .* \('#' before a row of units\)",
        ),
        (record, "r.mat", b"not a mat file at all", "cut short or spoilt .*; allowed: a whole file"),
        (record, "r.h5", b"not hdf5", "record"),
        (record, "r.wav", b"RIFFnothing", "record"),
        (record, "r.png", b"", "allowed: .csv"),
    ],
)
def test_reader__file_that_it_does_not_read__is_refused_in_one_line(tmp_path, read, name, content, words) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match=words) as refusal:
        read(tmp_path / name)
    assert "\n" not in str(refusal.value)
