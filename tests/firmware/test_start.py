"""The STM32F405's program as it is flashed, from its first instruction: out of reset, after a bootloader, with parts
missing. The host's own link speaks to it."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware.build import build, find_board
from firmware.verify import verify
from tactuator.errors import BadInput
from tactuator.rig.board.link import LinkClient, Missing, Mode, Request, RequestOutcome, RigIncomplete
from tactuator.rig.board.rig import BoardRig
from tests.firmware import chip_model as model
from tests.firmware.chip_model import Chip, Drivers
from tests.firmware.processor import Processor
from tests.rig.guard.guarded import designed

VECTORS = 0x08000000
SYSTICK_RUNS = 7


@pytest.fixture(scope="module")
def program() -> Path:
    return build(find_board("stm32f405"))


@pytest.fixture(scope="module")
def drivers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drivers")
    model.build(folder)
    return folder / "drivers.so"


@contextmanager
def started(program: Path, chip: Chip, after_bootloader: bool = False) -> Iterator[tuple[Processor, LinkClient]]:
    running = Processor(program, chip, after_bootloader)
    client = LinkClient(running, 5.0)
    try:
        yield running, client
    finally:
        client.close()


def after_a_bootloader(chip: Chip, pll: int, source: int, control: int = 0) -> Chip:
    """As one leaves it: the PLL is the clock, vectors, timer and interrupts are its own; a pin is open drain."""
    chip.registers.update({
        model.RCC: model.HSI_ON | model.HSE_ON | model.PLL_ON | control, model.RCC + 4: pll, model.RCC + 8: source,
        model.FLASH: 0x705, model.VTOR: 0x1FFF0000, model.SYSTICK: SYSTICK_RUNS, model.SYSTICK + 4: 60_000,
        model.NVIC: 0xFFFFFFFF, model.NVIC + 4: 0xFFFFFFFF, 0x40020400 + 4: 1 << 10,
        model.EXTI: 1 << 16, model.EXTI + 8: 1 << 16,
    })  # fmt: skip
    chip.pending = 1 << 16  # a fall of the supply that was its own affair
    return chip


STARTS = {
    "reset": Chip,
    "ST's DFU, 60 MHz": lambda: after_a_bootloader(Chip(), 16 | 120 << 6 | 7 << 24, 2),
    "a UF2 loader, 168 MHz from the crystal": lambda: after_a_bootloader(Chip(), 12 | 336 << 6 | 1 << 22, 2),
    "the crystal itself, bypassed": lambda: after_a_bootloader(Chip(), 12 | 336 << 6 | 1 << 22, 1, model.HSE_BYPASSED),
}


@pytest.mark.parametrize("chip", STARTS.values(), ids=STARTS)
def test_start__reset_or_a_bootloader__one_state_and_it_answers(program: Path, chip) -> None:
    after_bootloader, chip = chip is not Chip, chip()
    with started(program, chip, after_bootloader) as (_, client):
        status = client.status()
    assert (status.name, status.mode, status.missing) == ("stm32f405", Mode.OFF, 0)
    assert chip.system_hz == 168e6
    assert chip.registers[model.VTOR] == VECTORS
    assert chip.registers[model.SYSTICK] == 0
    assert not chip.registers[model.RCC] & model.HSE_BYPASSED
    disabled = [chip.registers.get(0xE000E180 + 4 * word, 0) for word in range(3)]
    assert disabled == [0xFFFFFFFF] * 3
    assert chip.registers[model.RCC + 0x10] == 0


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(16, 16), st.integers(100, 216), st.booleans(), st.sampled_from([0, 1, 2]))
def test_clock__whatever_runs_before__is_168_mhz(drivers: Path, divisor, times, from_crystal, source) -> None:
    pll = (12 if from_crystal else divisor) | 2 * times << 6 | from_crystal << 22
    chip = after_a_bootloader(Chip(), pll, source)
    on = Drivers(ctypes.CDLL(str(drivers)), chip)
    assert on.call("tact_chip_clock") == 0
    assert chip.system_hz == 168e6


def without_crystal(chip: Chip) -> None:
    chip.crystal_works = False


def without_a_d(chip: Chip) -> None:
    chip.input.busy_looks = None


def without_d_a(chip: Chip) -> None:
    chip.output.is_there = False


def low_supply(chip: Chip) -> None:
    chip.supply_is_low = True


def stuck_watchdog(chip: Chip) -> None:
    chip.reload_looks = 10**9


LACKS = {Missing.CRYSTAL: without_crystal, Missing.AD: without_a_d, Missing.DA: without_d_a, Missing.SUPPLY: low_supply}


@pytest.mark.parametrize("part", LACKS, ids=[part.name for part in LACKS])
def test_start__a_part_missing__it_answers_and_names_it_and_does_not_arm(program: Path, part: Missing) -> None:
    chip = Chip()
    LACKS[part](chip)
    with started(program, chip) as (_, client):
        assert client.status().missing == part
        rig = BoardRig(client, designed().display, waits=False)
        assert client.ask(Request.ARM)[0] is RequestOutcome.INCOMPLETE
        rig.load(designed())
        with pytest.raises(RigIncomplete, match=f"the board lacks: {part.words}; expected the wiring"):
            rig.play([[0.0, 0.0, 0.0]])
        assert client.status().mode is Mode.OFF
    assert (chip.pins["A4"], chip.pins["A5"]) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("lacks", [(without_a_d, without_d_a), (low_supply,)], ids=["converters", "supply"])
def test_start__a_part_missing__is_verified_bare_with_outputs_off(program: Path, lacks) -> None:
    chip = Chip()
    for lack in lacks:
        lack(chip)
    with started(program, chip) as (_, client):
        rig = BoardRig(client, designed().display, waits=False)
        assert rig.status().missing
        found = verify(rig, designed(), 1.0, bare=True)
    assert (found.first_difference, found.ticks >= 4000) == (None, True)
    assert ("pin", "A4", 1) not in chip.moved


def test_supply__low_at_start_and_back__arms_then_and_low_again__halts(program: Path) -> None:
    chip = Chip()
    low_supply(chip)
    with started(program, chip) as (running, client):
        BoardRig(client, designed().display, waits=False)
        assert client.ask(Request.ARM)[0] is RequestOutcome.INCOMPLETE
        chip.supply_is_low = False
        assert client.ask(Request.ARM)[0] is RequestOutcome.DONE
        for _ in range(100):
            running.step()
        assert chip.pins["A4"] == 1
        low_supply(chip)
        for _ in range(100):
            running.step()
        assert running.halted
    assert (chip.pins["A4"], chip.pins["A5"]) == (0, 0)


def test_whole_board__bare__is_refused(program: Path) -> None:
    with started(program, Chip()) as (_, client):
        rig = BoardRig(client, designed().display, waits=False)
        with pytest.raises(BadInput, match="the board lacks nothing; expected a run that is not bare"):
            verify(rig, designed(), 1.0, bare=True)


def test_watchdog__reload_not_in_force__is_missing_and_outputs_stay_off(program: Path) -> None:
    chip = Chip()
    stuck_watchdog(chip)
    with started(program, chip) as (_, client):
        BoardRig(client, designed().display, waits=False)
        assert client.status().missing == Missing.WATCHDOG
        assert client.ask(Request.ARM)[0] is RequestOutcome.INCOMPLETE
