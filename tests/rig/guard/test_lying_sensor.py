"""The guard against a sensor that lies: stuck but noisy, or jumping; its lock-out; the reference within travel."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.rig.board.commissioning import LOCK_FAULTS, LOCK_S, TRAVEL_SHARE
from tactuator.rig.board.link import Mode, Request, RequestOutcome, RigFault, RigLocked
from tactuator.rig.open import in_process_rig
from tactuator.runtime._core import lib
from tactuator.runtime.safety_table import Fault
from tests.rig.guard.felt_reference import FeltReference
from tests.rig.guard.guarded import Guarded, designed
from tests.rig.guard.lawful_play import CONTROLLERS, build, play
from tests.rig.guard.lying_sensor import DOCS, SITUATIONS, table

TRAVEL_MM, LOUDEST_DB_SL, RATE, SOFT = 12.5, 56.0, 4000, 410
CODES = (2, 60, -200, 700, -6422, 20000)


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


ANY_CODES = sorted({sign * round(10**x) for x in np.linspace(0.3, 4.5, 60) for sign in (1, -1)})


@pytest.mark.parametrize(
    ("code", "resets", "ticks"),
    [*((code, 2, 3000) for code in CODES), *(pytest.param(c, 30, 12_000, marks=pytest.mark.soak) for c in ANY_CODES)],
)
def test_stuck_sensor__reset_again_and_again__motor_stays_within_travel_and_comfort(code, resets, ticks) -> None:
    furthest_mm, loudest_db_sl, notices = stuck(code, resets, ticks)
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


def test_lock_out__sensor_fault__is_cleared_after_a_second_and_three_are_acknowledged() -> None:
    with in_process_rig(designed().display, 1) as rig:
        rig.load(designed())
        for count in range(1, LOCK_FAULTS + 1):
            with pytest.raises(BadInput, match="sensor fault 'drunk'; allowed: sound, open"):
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


def test_lock_out__sensor_fault__is_not_cleared_within_a_second_but_a_late_interrupt_at_once() -> None:
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
    made = table()
    assert made in DOCS.read_text(encoding="utf-8")
    assert all(name in made for name in SITUATIONS)


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
    [(controller, 1, 300.0 if controller == "fixed" else 150.0) for controller in CONTROLLERS] + SOAKED,
)
def test_lawful_play__sound_sensors__trip_nothing(lawful: Path, controller: str, seed: int, seconds: float) -> None:
    """Before the guard took every tick's command into account, white noise was a stuck sensor once in 50 s."""
    found = play(lawful, seed, seconds, controller)
    assert found.faults == {}
    assert found.running_s > 0.98 * seconds
