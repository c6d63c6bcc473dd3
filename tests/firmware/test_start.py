"""The STM32F405's whole program from its start, on the model of the chip: out of reset, after a bootloader, with parts
missing. The host's own link speaks to it."""

import ctypes
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware.verify import verify
from tactuator.errors import BadInput
from tactuator.rig.board.link import LinkClient, Missing, Mode, Request, RequestOutcome, RigIncomplete
from tactuator.rig.board.rig import BoardRig
from tests.firmware import chip_model as model
from tests.firmware.chip_model import Chip, Drivers, build
from tests.rig.guard.guarded import designed

VECTORS = 0x08000000
TICKS_A_SECOND = 2000.0
"""Half of what the board does: the model and the host share this machine."""
SYSTICK_RUNS = 7


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("program")
    build(folder)
    return folder / "drivers.so"


class Started:
    """The program on a chip, in a thread of its own: time goes on where it sleeps. A transport of the host's link."""

    def __init__(self, program: Path, chip: Chip) -> None:
        self.chip = chip
        copy = program.with_name(f"{time.monotonic_ns()}.so")  # its memory as out of reset
        shutil.copyfile(program, copy)
        self.drivers = Drivers(ctypes.CDLL(str(copy)), chip)
        copy.unlink()
        self._sleep = model.SLEEP(self._let_time_pass)
        pointer = ctypes.cast(self._sleep, ctypes.c_void_p).value
        ctypes.c_void_p.in_dll(self.drivers.compiled, "model_sleep").value = pointer
        self._ends, self.how, self.objection = False, 0, None
        self._ticked_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.how = self.drivers.call("model_start", ctypes.c_uint32(VECTORS))
        except BaseException as error:
            self.objection = error

    def _let_time_pass(self) -> int:
        if self.chip.supply_halts:
            self.drivers.compiled.tact_halt()
        while self.chip.from_host:
            self.drivers.compiled.tact_usart()
        due = min(int((time.monotonic() - self._ticked_s) * TICKS_A_SECOND), 8)
        for _ in range(due):
            if self.chip.registers.get(model.SYSTICK, 0) & SYSTICK_RUNS == SYSTICK_RUNS:
                self.chip.registers[model.SYSTICK + 8] = self.chip.registers[model.SYSTICK + 4]
                self.drivers.compiled.tact_systick()
        if due:
            self._ticked_s = time.monotonic()
        else:
            time.sleep(1e-4)
        return self._ends or bool(self.drivers.objections)

    def send(self, content: bytes) -> None:
        self.chip.from_host.extend(content)

    def receive(self, timeout_s: float) -> bytes:
        end_s = time.monotonic() + timeout_s
        while not self.chip.to_host and self._thread.is_alive() and time.monotonic() < end_s:
            time.sleep(1e-4)
        if self.objection is not None:
            raise self.objection
        content, self.chip.to_host[:] = bytes(self.chip.to_host), []
        return content

    def close(self) -> None:
        self._ends = True
        self._thread.join(20.0)
        if self.objection is not None:
            raise self.objection


@contextmanager
def started(program: Path, chip: Chip) -> Iterator[tuple[Started, LinkClient]]:
    running = Started(program, chip)
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
    chip = chip()
    with started(program, chip) as (running, client):
        status = client.status()
    assert (status.name, status.mode, status.missing) == ("stm32f405", Mode.OFF, 0)
    assert chip.system_hz == 168e6
    assert chip.registers[model.VTOR] == VECTORS
    assert chip.registers[model.SYSTICK] == 0
    assert not chip.registers[model.RCC] & model.HSE_BYPASSED
    disabled = [chip.registers.get(0xE000E180 + 4 * word, 0) for word in range(3)]
    assert disabled == [0xFFFFFFFF] * 3
    assert chip.registers[model.RCC + 0x10] == 0
    assert running.how == model.ENDED


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(16, 16), st.integers(100, 216), st.booleans(), st.sampled_from([0, 1, 2]))
def test_clock__whatever_runs_before__is_168_mhz(program: Path, divisor, times, from_crystal, source) -> None:
    pll = (12 if from_crystal else divisor) | 2 * times << 6 | from_crystal << 22
    chip = after_a_bootloader(Chip(), pll, source)
    on = Drivers(ctypes.CDLL(str(program)), chip)
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
        end_s = time.monotonic() + 5.0
        while chip.pins["A4"] != 1 and time.monotonic() < end_s:
            time.sleep(0.001)
        assert chip.pins["A4"] == 1
        low_supply(chip)
        while running.how == 0 and time.monotonic() < end_s + 5.0:
            time.sleep(0.001)
    assert running.how == model.HALTED


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
