"""What a document's files are refused for goes to the server's log, once, and not to the reader."""

import pytest

from tactuator.errors import BadInput, named_file, unquoted


def test_unquoted__asked_a_thousand_times__one_line_each_for_what_differs(tmp_path, caplog) -> None:
    for name in ("first", "second"):
        (tmp_path / name).write_text("secret")
        for _ in range(1000):
            with (
                pytest.raises(BadInput, match="the server's terminal says why") as refused,
                unquoted(),
                named_file(tmp_path / name, "the curve"),
            ):
                raise BadInput(f"line 1 of {name} is 'secret'", "numbers")
            assert "secret" not in str(refused.value)
    assert [record.getMessage().count("secret") for record in caplog.records] == [1, 1]
