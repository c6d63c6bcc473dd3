"""Files of every kind at every verb that takes a file: one of another kind is told what it is, and what takes it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.experiment.store.store import Store
from tactuator.io.controller import write_controller
from tactuator.io.csv_tables import write_contours
from tactuator.io.display import write_environment
from tactuator.io.kinds import KINDS, kind_of
from tactuator.io.model import write_model
from tactuator.io.record import write_record
from tactuator.io.reference import ReferenceHead, write_reference
from tactuator.io.response import write_responses
from tactuator.io.shipped import EXAMPLES
from tactuator.model.plant_model import PlantModel
from tactuator.perception.contours import Contours
from tactuator.signals.record import Record, Response
from tests.measure.loops import controller, display

FILES = {
    "display": "bench.toml", "record": "record.h5", "record in text": "bench.csv", "response": "sheet.csv",
    "measured": "measured.h5", "model": "model.json", "controller": "controller.json", "image": "image.bin",
    "reference": "reference.wav", "reference in HDF5": "reference.h5", "sound": "speech.wav",
    "protocol": "protocol.toml", "store": "store.sqlite", "curve": "curve.csv", "loss": "loss.csv",
    "pairs": "pairs.csv", "environment": "environment.json", "matrix": "confusion.csv", "coding": "coding.toml",
    "coupling": "coupling.json", "contours": "contours.csv",
}  # fmt: skip
VERBS = {
    "design FILE": {"display"},
    "design GOOD/bench.toml --curve FILE": {"curve"},
    "check FILE": {"controller"},
    "check GOOD/controller.json --display FILE": {"display"},
    "wordlength FILE": {"controller"},
    "build FILE --out GOOD/new.bin": {"controller"},
    "image FILE": {"image"},
    "image GOOD/image.bin --controller FILE": {"controller"},
    "identify FILE": {"record", "response", "measured", "sound"},
    "identify GOOD/record.h5 --validate FILE": {"record", "response", "sound"},
    "calibrate FILE": {"pairs"},
    "record FILE --out GOOD/new.h5": {"display"},
    "measure --controller FILE": {"controller"},
    "measure --display FILE": {"display"},
    "noise --controller FILE": {"controller"},
    "disturb --controller FILE": {"controller"},
    "finger --controller FILE": {"controller"},
    "init --from FILE --out GOOD/new.toml": {"model"},
    "render FILE --controller GOOD/controller.json --out GOOD/new.wav": {"sound"},
    "render GOOD/speech.wav --coding FILE --controller GOOD/controller.json --out GOOD/new.wav": {"coding"},
    "play FILE --controller GOOD/controller.json": {"reference", "sound"},
    "experiment serve FILE --store GOOD/new.sqlite": {"protocol"},
    "experiment thresholds --store FILE": {"store"},
    "experiment export --store FILE --out GOOD/new": {"store"},
    "experiment information --store FILE": {"store"},
    "experiment information --matrix FILE": {"matrix"},
    "experiment simulate --procedure curve --truth FILE": {"loss"},
    "calibrate-display FILE": {"display"},
    "firmware verify --controller FILE": {"controller"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    lab = tmp_path_factory.mktemp("lab")
    shutil.copytree(EXAMPLES, lab, dirs_exist_ok=True)
    designed, rng, two = controller(display()), np.random.default_rng(0), np.ones(2)
    write_controller(lab / "controller.json", designed)
    assert main(["build", str(lab / "controller.json"), "--out", str(lab / "image.bin")]) == 0
    model = PlantModel(np.array([2875.0]), np.array([1.0, 94.0, 290.0]), 0.0, np.zeros((4, 4)), (0.4, 300.0))
    write_model(lab / "model.json", model)
    write_record(lab / "record.h5", Record(1000.0, rng.standard_normal(500), rng.standard_normal(500)))
    flags = np.zeros(2, dtype=bool)
    measured = Response("index", "none", 20.0, "multisine", np.array([1.0, 2.0]), two + 0j, two, two, two, two, flags,
                        flags, two)  # fmt: skip
    write_responses(lab / "measured.h5", [measured])
    for name in ("reference.wav", "reference.h5"):
        with write_reference(lab / name, ReferenceHead(4000.0, ("index",))) as writer:
            writer.write(np.zeros((400, 1)))
    Store(lab / "store.sqlite").close()
    write_environment(lab / "environment.json", {"index": {}})
    (lab / "coupling.json").write_text('{"format": "tactuator-coupling/1"}')
    write_contours(lab / "contours.csv", Contours("P1", [30.0, 300.0], [20.0], [[20.0, 20.0]]))
    return lab


def test_kind__file_of_each_noun__is_known_by_its_content_alone(folder: Path, tmp_path: Path) -> None:
    for noun, name in FILES.items():
        moved = tmp_path / f"anything{Path(name).suffix if noun.startswith('reference') else ''}"
        shutil.copy(folder / name, moved)
        assert kind_of(moved) == noun.split()[0]


@pytest.mark.parametrize("command", VERBS)
def test_verb__file_of_another_kind__says_what_it_is_and_what_takes_it(command: str, folder: Path, capsys) -> None:
    """Three other kinds at each verb, and each kind at three verbs or more."""
    capsys.readouterr()
    first = 3 * list(VERBS).index(command) % len(FILES)
    others = [noun for noun in [*FILES][first:] + [*FILES][:first] if noun.split()[0] not in VERBS[command]]
    for noun in others[:3]:
        kind, name, before = noun.split()[0], FILES[noun], sorted(folder.iterdir())
        words = command.replace("FILE", str(folder / name)).replace("GOOD", str(folder)).split()
        status, (out, err) = main(words), capsys.readouterr()
        assert (status, out, err.count("\n")) == (2, "", 1), (noun, status, out, err)
        assert f"this is {KINDS[kind].words}: {KINDS[kind].goes}; allowed: " in err, (noun, err)
        assert sorted(folder.iterdir()) == before


def test_kind__of_what_is_none__is_not_guessed(tmp_path: Path) -> None:
    for name, content in {"a.csv": b"", "b.json": b"{}", "c.toml": b"x = 1", "d.bin": bytes(200)}.items():
        (tmp_path / name).write_bytes(content)
        assert kind_of(tmp_path / name) is None
    assert kind_of(tmp_path) is None
    assert kind_of(tmp_path / "nothing") is None
