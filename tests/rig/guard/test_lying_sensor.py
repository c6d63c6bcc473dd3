"""The guard against a sensor that lies: stuck but noisy, or jumping; its lock-out; the reference within travel."""

import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.commissioning import LOCK_FAULTS, LOCK_S, TRAVEL_SHARE, safety_table
from tactuator.rig.board.link import Mode, Request, RequestOutcome, RigFault, RigLocked
from tactuator.rig.open import in_process_rig
from tactuator.runtime._core import lib
from tactuator.runtime.image import build_image
from tactuator.runtime.safety_table import Fault, safety_bytes
from tactuator.runtime.tables import simulated_board_bytes
from tests.rig.guard.felt_reference import FeltReference
from tests.rig.guard.guarded import Guarded, adaptive, designed

SITUATIONS = {"silence": (0.0, 0.0), "2 Hz, 40 dB SL": (2.0, 100.0), "30 Hz, 40 dB SL": (30.0, 100.0)}
LIES: tuple[tuple[str, str, float], ...] = (
    ("open", "open", 0.0), ("shorted", "shorted", 0.0), ("frozen", "frozen", 0.0), ("reversed", "reversed", 0.0),
    ("stuck where it is, ±2 codes", "stuck", math.nan), ("stuck at code 1000, ±2", "stuck", 1000.0),
    ("offset, step of 5 mV", "offset", 5e-3), ("offset, step of 50 mV", "offset", 50e-3),
    ("offset, step of 0.5 V", "offset", 0.5), ("drift of 0.1 V/s", "drift", 0.1 / 4000.0),
    ("drift of 10 V/s", "drift", 10.0 / 4000.0), ("gain a half", "gain", 0.5), ("gain a tenth", "gain", 0.1),
    ("gain doubled", "gain", 2.0), ("lag of 1 ms", "lag", 4.0), ("lag of 10 ms", "lag", 40.0),
    ("the next channel's reading", "swapped", 1.0), ("bit 4 turned over", "bit", 4.0),
    ("bit 10 turned over", "bit", 10.0), ("an end stop at 1 mm", "end stop", 1.0),
)  # fmt: skip
BEFORE, AFTER, RATE_HZ = 900, 6000, 4000.0
DOCS = Path(__file__).resolve().parents[3] / "docs" / "safety.md"
BEGIN, END = "<!-- lies: begin -->\n", "<!-- lies: end -->\n"


def try_lie(lie: tuple[str, str, float], situation: str) -> str:
    """Of one lie on the first channel, in one situation: the fault that the guard reports within AFTER ticks, the time
    until then in ms, and the greatest displacement in mm."""
    hertz, amplitude = SITUATIONS[situation]
    guarded = Guarded(designed())
    time_s = np.arange(BEFORE + AFTER) / RATE_HZ
    wave = amplitude * np.sin(2.0 * np.pi * hertz * time_s)
    other = 0.5 * amplitude * np.sin(2.0 * np.pi * 1.7 * hertz * time_s)
    rows = np.stack([wave, other, other], axis=1)
    assert guarded.run(rows[:BEFORE]).fault is Fault.NONE
    guarded.break_sensor(lie[1], 0, lie[2])
    run = guarded.run(rows[BEFORE:])
    far_mm = f"{float(np.max(np.abs(run.displacement_mm[:, 0]))):.2g}"
    if run.fault_at is None:
        return f"none, {far_mm}"
    after_ms = 1e3 * run.fault_at / RATE_HZ
    name = run.fault.words.removeprefix("sensor ")
    return f"{name}, {f'{after_ms:.0f}' if after_ms >= 100.0 else f'{after_ms:.3g}'}, {far_mm}"


def table() -> str:
    lines = ["| what the sensor does | " + " | ".join(SITUATIONS) + " |", "|---|" + "---|" * len(SITUATIONS)]
    lines += [f"| {lie[0]} | " + " | ".join(try_lie(lie, situation) for situation in SITUATIONS) + " |" for lie in LIES]
    return "\n".join(lines) + "\n"


def main() -> None:
    before, rest = DOCS.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    DOCS.write_text(before + BEGIN + "\n" + table() + "\n" + END + after, encoding="utf-8")


ROOT = Path(__file__).resolve().parents[3]
_PARTS = ("arithmetic", "board", "control", "display", "link", "strength", "touch", "wire")
CONTROLLERS = ("fixed", "adaptive")
_FLAGS = ("-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")


def build(folder: Path) -> Path:
    """Compile the program with the tables of the example display, fixed and adaptive, into `folder`."""
    contents = {
        "SAFETY_FIXED": safety_bytes(safety_table(designed().display)),
        "SAFETY_ADAPTIVE": safety_bytes(safety_table(adaptive().display)),
        "IMAGE_FIXED": build_image(designed()),
        "IMAGE_ADAPTIVE": build_image(adaptive()),
        "DISPLAY": simulated_board_bytes(designed().display, 1),
    }
    arrays = (f"static const uint8_t {name}[] = {{{','.join(map(str, of))}}};\n" for name, of in contents.items())
    (folder / "tables.h").write_text("".join(arrays))
    sources = [str(path) for part in _PARTS for path in sorted((ROOT / "core" / part).glob("*.c"))]
    program = folder / "lawful-play"
    ours = Path(__file__).with_name("lawful_play.c")
    subprocess.run(["cc", *_FLAGS, f"-I{ROOT / 'core'}", f"-I{folder}", ours, *sources, "-o", program], check=True)
    return program


def play(program: Path, seed: int, seconds: float, controller: str) -> tuple[float, dict[str, int]]:
    """Run the program for so many simulated seconds on one of CONTROLLERS; the same seed plays the same. Return the
    seconds in a run, and how often each fault occurred."""
    which = str(CONTROLLERS.index(controller))
    said = subprocess.run([program, str(seed), str(seconds), which], capture_output=True, text=True, check=True).stdout
    found = re.search(r"seconds (\S+) running (\S+) runs (\d+)((?: \d+)+)", said)
    assert found, said
    counts = map(int, found[4].split())
    faults = {fault.words: count for fault, count in zip(list(Fault)[1:], counts, strict=True) if count}
    return float(found[2]), faults


TRAVEL_MM, LOUDEST_DB_SL, RATE, SOFT = 12.5, 56.0, 4000, 410
CODES = (2, -200, 20000)


def reset(guarded: Guarded) -> list[np.ndarray]:
    """Clear, acknowledge and start again as soon as the board lets us; what moved until then."""
    moved = []
    for _ in range(100):
        moved.append(guarded.run(np.zeros((100, 3))).displacement_mm)
        if lib.tact_board_clear(guarded.board):
            break
    lib.tact_board_acknowledge(guarded.board, guarded.board.sensor_faults)
    assert lib.tact_board_arm(guarded.board)
    guarded.start()
    return moved


def stuck(code: int, resets: int, ticks: int) -> tuple[float, float, int]:
    """How far the motor went at most, in mm; the loudest after the first three notices, in dB SL; the resets."""
    guarded = Guarded(designed(), seed=abs(code) + 1)
    moved, notices = [guarded.run(np.zeros((900, 3))).displacement_mm], []
    guarded.break_sensor("stuck", 0, float(code))
    for _ in range(resets):
        run = guarded.run(np.zeros((ticks, 3)))
        if run.fault_at is not None:
            notices.append(sum(map(len, moved)) + run.fault_at)
        moved.append(run.displacement_mm)
        if guarded.mode is not Mode.FAULT:
            break
        moved += reset(guarded)
    displacement = np.concatenate(moved)[:, 0]
    judge, loudest = FeltReference(designed(), 0), 0.0
    for at in notices[:3]:
        since = max(0, at - 9000)
        loudest = max(loudest, np.max(np.abs(judge.of(displacement[since : at + 3000]))[at + 1 - since :]))
    return float(np.max(np.abs(displacement))), 20.0 * np.log10(loudest) if loudest else -np.inf, len(notices)


@pytest.mark.parametrize("code", CODES)
def test_stuck_sensor__reset_again_and_again__motor_stays_within_travel_and_comfort(code) -> None:
    furthest_mm, loudest_db_sl, notices = stuck(code, resets=2, ticks=3000)
    assert notices
    assert furthest_mm < TRAVEL_MM
    assert loudest_db_sl < LOUDEST_DB_SL


@pytest.mark.parametrize("hertz", [0.4, 2.0, 12.0])
def test_reference__as_loud_as_may_be__takes_its_share_of_travel_and_no_more(hertz: float) -> None:
    guarded = Guarded(designed())
    time_s = np.arange(SOFT + round(RATE * max(1.0, 1.2 / hertz))) / RATE
    run = guarded.run(np.repeat(1e4 * np.sin(2.0 * np.pi * hertz * time_s)[:, None], 3, axis=1))
    assert run.fault is Fault.NONE
    furthest = np.max(np.abs(run.displacement_mm))
    assert furthest < 1.3 * TRAVEL_SHARE * TRAVEL_MM  # a clipped sinusoid; 0.85 of the travel would be a fault
    assert furthest > 0.2 * TRAVEL_MM


def test_lock_out__sensor_fault__is_cleared_after_a_second() -> None:
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        for count in range(1, LOCK_FAULTS + 1):
            with pytest.raises(BadInput, match="sensor fault 'drunk'; expected sound, open"):
                rig.break_sensor("index", "drunk")
            with pytest.raises(BadInput, match="sensor fault 'drift' without a value"):
                rig.break_sensor("index", "drift")
            rig.break_sensor("index", "open")
            with pytest.raises(RigFault):
                rig.play(np.zeros((200, 3)))
            assert rig.status().sensor_faults == count
            rig.break_sensor("index", "sound")
            rig.off()
        with pytest.raises(RigLocked, match="locked after 3 sensor or travel faults"):
            rig.play(np.zeros((20, 3)))
        assert rig.status().mode is Mode.OFF
        assert rig.client.ask(Request.ACKNOWLEDGE, (99).to_bytes(4, "little"))[0] is RequestOutcome.BAD_PAYLOAD
        assert rig.client.acknowledge() == rig.client.acknowledge() == LOCK_FAULTS
        assert len(rig.play(np.zeros((20, 3)))) == 20


def test_lock_out__sensor_fault__is_not_cleared_within_a_second() -> None:
    guarded = Guarded(designed())
    guarded.run(np.zeros((SOFT, 3)))
    assert guarded.run(np.zeros((900, 3)), lateness=200).fault is Fault.LATE
    assert lib.tact_board_clear(guarded.board)
    assert guarded.board.sensor_faults == 0
    assert lib.tact_board_arm(guarded.board)
    guarded.start()
    guarded.break_sensor("open")
    run = guarded.run(np.zeros((200, 3)))
    assert run.fault is Fault.SENSOR_OPEN
    passed = 200 - run.fault_at
    while not lib.tact_board_clear(guarded.board):
        guarded.run(np.zeros((1, 3)))
        passed += 1
    assert passed == pytest.approx(LOCK_S * RATE, abs=3)


@pytest.mark.slow
def test_documentation__table_of_lies__is_what_a_run_gives() -> None:
    """Of each lie one situation, in turn."""
    rows = [line.strip("|").split(" | ") for line in DOCS.read_text(encoding="utf-8").split(BEGIN)[1].splitlines()]
    cells = {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows if len(row) > len(SITUATIONS)}
    assert cells.keys() == {"what the sensor does", *(lie[0] for lie in LIES)}
    for number, lie in enumerate(LIES):
        column = number % len(SITUATIONS)
        assert cells[lie[0]][column] == try_lie(lie, list(SITUATIONS)[column])


@pytest.fixture(scope="module")
def lawful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("lawful"))


SOAKED = [  # the finger fed forward for a tenth of that time in either format
    pytest.param(controller, seed, 1e5 if controller == "fixed" else 1e4, marks=pytest.mark.soak)
    for controller in CONTROLLERS
    for seed in range(2, 12)
]


@pytest.mark.parametrize(
    ("controller", "seed", "seconds"),
    [(controller, 1, 150.0 if controller == "fixed" else 75.0) for controller in CONTROLLERS] + SOAKED,
)
def test_lawful_play__sound_sensors__trip_nothing(lawful: Path, controller: str, seed: int, seconds: float) -> None:
    """Before the guard took every tick's command into account, white noise was a stuck sensor once in 50 s."""
    running_s, faults = play(lawful, seed, seconds, controller)
    assert faults == {}
    assert running_s > 0.98 * seconds


if __name__ == "__main__":
    main()
