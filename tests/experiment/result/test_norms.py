"""Norms by age: a file with its source, and nothing else."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.result.group_level import read_norm

HEAD = "# source: a made-up table, of no people\nfinger,age_low,age_high,frequency_hz,mean_db_re_1um,sd_db\n"


def norm(tmp_path, text):
    (tmp_path / "norm.csv").write_text(text)
    return read_norm(tmp_path / "norm.csv")


def test_norm__of_finger_age_and_frequency__gives_z_of_the_normal_distribution(tmp_path) -> None:
    read = norm(tmp_path, HEAD + "index,20,39,125,-4.0,3.0\nany,40,60,125,0.0,4.0\n")
    assert read.source == "a made-up table, of no people"
    rng = np.random.default_rng(1)
    z = [read.row("index", 31.0, 125.0).z(level) for level in rng.normal(-4.0, 3.0, 20_000)]
    assert np.mean(z) == pytest.approx(0.0, abs=0.03)
    assert np.std(z) == pytest.approx(1.0, abs=0.02)
    assert read.row("thumb", 40.0, 125.0).z(8.0) == 2.0
    for nobody in (("thumb", 31.0, 125.0), ("index", 61.0, 125.0), ("index", 31.0, 31.5), ("index", None, 125.0)):
        assert read.row(*nobody) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.partition("\n")[2] + "index,20,39,125,-4,3\n", "no source"),
        ("# source: x\nfinger,frequency_hz\n", "columns finger, frequency_hz"),
        (HEAD + "index,20,39,125,-4,0\n", "sd_db 0"),
        (HEAD + "index,39,20,125,-4,3\n", "ages 39 to 20"),
        (HEAD + "index,20,39,125,x,3\n", "a number in each"),
        (HEAD + "index,20,39,125,nan,3\n", "finite"),
        (HEAD + "index,20,39,125\n", "a number in each"),
        (HEAD + "index,20,39,125,-4,3\nindex,30,50,125,-2,3\n", "two rows"),
    ],
)
def test_norm__that_is_none__is_refused(tmp_path, text, message) -> None:
    with pytest.raises(BadInput, match=message):
        norm(tmp_path, text)
