"""Hostile files of each format: every one ends in an answer or in one line, in bounded memory.

What is altered in few places, in `test_clip`."""

import json
import random
import re
import subprocess
import sys

import pytest

from tests.patterns.formats import ACF, HJIF
from tests.patterns.test_clip import AHAP, BASIC, HAPTIC

PROFILE = "frequency_hz,acceleration_g\n" + "".join(f"{hertz},{hertz / 100}\n" for hertz in range(30, 301, 10))
GOOD = {
    **{f"a.{kind}": json.dumps(file, indent=1) for kind, file in (("haptic", HAPTIC), ("ahap", AHAP), ("hjif", HJIF))},
    "a.xml": BASIC, "a.acf": ACF, "a.csv": PROFILE,
}  # fmt: skip
MOST_KB = 700_000
CHILD = """
import resource, sys
from pathlib import Path
from tactuator.errors import BadInput
from tactuator.patterns.acf import read_acf
from tactuator.patterns.android import read_profile
from tactuator.patterns.files import read_clip
soft = int(sys.argv[2]) * 1024
resource.setrlimit(resource.RLIMIT_DATA, (soft, soft))
read = {".acf": read_acf, ".csv": read_profile}
lines = answers = 0
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read.get(path.suffix, read_clip)(path)
        answers += 1
    except BadInput as error:
        assert "\\n" not in str(error) and len(str(error)) < 1000, path
        lines += 1
own = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))  # ru_maxrss has the parent's too
print(answers, lines, own.split()[1])
"""


def long(good, rng):
    """A part that stands very often: up to some megabytes of it."""
    places = list(re.finditer(r"\{[^{}]*\}|<control[^>]*>|\n[\d.,]+", good))
    place = rng.choice(places)
    joint = "," if place[0].startswith("{") else ""
    times = rng.choice([1000, 100_001, 6_000_000 // len(place[0])])
    return good[: place.start()] + joint.join([place[0]] * times) + good[place.end() :]


def nested(good, rng):
    at, deep = rng.randrange(len(good)), rng.choice([50, 5000, 1_000_000])
    opened = rng.choice(["[", "{", '{"a":', "<a>", "/*", "'", "\\"])
    return good[:at] + opened * deep + good[at:]


def spoilt(good, rng):
    content = bytearray(good.encode())
    for _ in range(rng.randint(1, 16)):
        content[rng.randrange(len(content))] = rng.randrange(256)
    return bytes(content)


def encoded(good, rng):
    kind = rng.choice(["utf-16", "utf-8-sig", "utf-32", "utf-7", "cp500", "utf-16-be"])
    return good.encode(kind)


def swollen(good, rng):
    """Little that becomes much where it is taken apart: spaces, a string, numbers, entities."""
    much = rng.choice([" " * 11_000_000, '"' + "a" * 11_000_000 + '"', "[" + "0," * 5_000_000 + "0]",
                       "[" + "{}," * 3_000_000 + "{}]", "&#65;" * 2_000_000, "a" * 13_000_000])  # fmt: skip
    at = rng.randrange(len(good))
    return good[:at] + much + good[at:]


HARM = (long, nested, spoilt, encoded, swollen)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(GOOD))
@pytest.mark.parametrize("count", [5, pytest.param(200, marks=pytest.mark.soak)])
def test_hostile__many_files__each_ends_in_an_answer_or_a_line_in_bounded_memory(tmp_path, name, count) -> None:
    rng = random.Random(name)
    for number in range(count):
        content = HARM[number % len(HARM)](GOOD[name], rng)
        path = tmp_path / f"{number:03}{name[1:]}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    command = [sys.executable, "-c", CHILD, str(tmp_path), str(2 * MOST_KB)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")
    answers, lines, most_kb = map(int, done.stdout.split())
    assert answers + lines == count
    assert lines >= count // 4  # most harm is noticed; what is not, is a file that keeps the rules
    assert most_kb < MOST_KB
