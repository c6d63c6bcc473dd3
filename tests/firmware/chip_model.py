"""A model of what the STM32F405's program sees around its processor: registers, pins, and both converters behind SPI.

Written from the makers' documents (RM0090, the data sheets of AD7606 and AD5754R), not from the drivers: pins move and
bytes are shifted as they would be, and what a chip would not take is not taken.
"""

import ctypes
import shlex
import subprocess
import sysconfig
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
SOURCES = ("main.c", "stm32f405/port_stm32f405.c", "stm32f405/bus.c",
           "stm32f405/watchdog.c", "stm32f405/usart.c", "stm32f405/silicon/ad5754.c",
           "stm32f405/silicon/ad7606.c", "stm32f405/silicon/clock.c", "stm32f405/silicon/converters.c",
           "cortex_m/systick.c", "cortex_m/processor.c")  # fmt: skip
STUB = """
#include <stdint.h>
uint32_t (*model_get)(uint32_t); void (*model_set)(uint32_t, uint32_t);
uint32_t tact_get(uint32_t a) { return model_get(a); }
void tact_set(uint32_t a, uint32_t v) { model_set(a, v); }
void tact_halt(void) {}
void tact_sleep_unless(int (*reason)(void)) { (void)reason; }
uint32_t tact_interrupts_enter(void) { return 0; }
void tact_interrupts_leave(uint32_t before) { (void)before; }
"""

PORTS = {0x40020000: "A", 0x40020400: "B", 0x40020800: "C"}
MODE, IN, SET, FUNCTION_HIGH = 0x00, 0x10, 0x18, 0x24
SPI2, USART3, RCC, FLASH, IWDG = 0x40003800, 0x40004800, 0x40023800, 0x40023C00, 0x40003000
DWT, DEMCR = 0xE0001000, 0xE000EDFC
PWR, EXTI, NVIC = 0x40007000, 0x40013C00, 0xE000E100
SYSTICK, WRAPPED = 0xE000E010, 1 << 16
FULL_V, STEP_V = 10.0, 20.0 / 65536.0
CRYSTAL_HZ, INTERNAL_HZ = 12e6, 16e6
VTOR = 0xE000ED08
HSI_ON, HSE_ON, HSE_BYPASSED, PLL_ON = 1, 1 << 16, 1 << 18, 1 << 24
READY = 1 << 1 | 1 << 17 | 1 << 25
CLOCKED = {0x40020000: (0x30, 1), 0x40020400: (0x30, 2), 0x40020800: (0x30, 4), SPI2: (0x40, 1 << 14),
           USART3: (0x40, 1 << 18), PWR: (0x40, 1 << 28)}  # fmt: skip
"""Of each peripheral, the register of RCC that switches its clock, and its bit (RM0090, 7.3)."""


@dataclass
class Ad7606:
    """Eight inputs, sampled when CONVST rises. `busy_looks`: how often BUSY is seen high; None: it never rises."""

    volts: list[float] = field(default_factory=lambda: [0.0] * 8)
    busy_looks: int | None = 5
    held: list[int] = field(default_factory=lambda: [0] * 8)
    busy: int = 0
    bits: list[int] = field(default_factory=list)

    def convert(self) -> None:
        """CONVST rose."""
        if self.busy_looks is None:
            return
        self.busy = self.busy_looks
        self.held = [max(-32768, min(32767, round(v / STEP_V))) for v in self.volts]

    def select(self) -> None:
        """CS fell: the registers are shifted out from the first channel on."""
        self.bits = [code >> place & 1 for code in self.held for place in range(15, -1, -1)]

    def exchange(self, byte: int) -> int:
        """Eight clocks; it has no input."""
        del byte
        taken, self.bits = self.bits[:8], self.bits[8:]
        return int("".join(map(str, taken)).ljust(8, "0"), 2)


@dataclass
class Ad5754:
    """Four outputs: codes become volts when LDAC falls, and CLR low holds them at zero."""

    ranges: list[int] = field(default_factory=lambda: [0] * 4)
    power: int = 0
    alerts: int = 0
    settings: int = 0
    written: list[int] = field(default_factory=lambda: [0] * 4)
    loaded: list[int] = field(default_factory=lambda: [0] * 4)
    bits: list[int] = field(default_factory=list)
    answer: int = 0
    is_there: bool = True
    clear_low: bool = True

    def select(self) -> None:
        """SYNC fell."""
        self.bits = []

    def exchange(self, byte: int) -> int:
        """Eight clocks in, and eight of what was asked for before."""
        at = len(self.bits)
        self.bits += [byte >> place & 1 for place in range(7, -1, -1)]
        return self.answer >> max(16 - at, 0) & 255 if self.is_there and at < 24 else 0

    def deselect(self) -> None:
        """SYNC rose: a frame of 24 bits is carried out; any other is none."""
        if len(self.bits) != 24:
            return
        frame = int("".join(map(str, self.bits)), 2)
        reads, register, address, data = frame >> 23, frame >> 19 & 7, frame >> 16 & 7, frame & 0xFFFF
        if reads:
            value = (self.written[address & 3], self.ranges[address & 3], self.power | self.alerts, 0)[register]
            self.answer = frame & 0x7F0000 | value
            return
        channels = range(4) if address == 4 else [address]
        if register == 0:
            for c in channels:
                self.written[c] = data - 65536 if data >= 32768 else data
        elif register == 1:
            for c in channels:
                self.ranges[c] = data & 7
        elif register == 2:
            self.power = data & 0x1F
        elif register == 3 and address == 1:
            self.settings = data

    def load(self) -> None:
        """LDAC fell."""
        if not self.clear_low:
            self.loaded = list(self.written)

    def clear(self, low: bool) -> None:
        """CLR moved."""
        self.clear_low = low
        if low:
            self.written, self.loaded = [0] * 4, [0] * 4

    @property
    def volts(self) -> list[float]:
        """Of the outputs: a channel without power gives none; only the range of +/- 10 V is told here."""
        ready = [self.ranges[c] == 4 and self.power >> c & 1 and self.power >> 4 & 1 for c in range(4)]
        return [code * STEP_V if good else 0.0 for code, good in zip(self.loaded, ready, strict=True)]


class Chip:
    """Registers and pins. Pins: "A4" and so on, 1 or 0; `moved`: every write of pins and modes, in order."""

    def __init__(self) -> None:
        self.registers: dict[int, int] = {}
        self.pins: dict[str, int] = {}
        self.moved: list[tuple[str, str, int]] = []
        self.input, self.output = Ad7606(), Ad5754()
        self.spi_stands, self.crystal_works = False, True
        self.received: list[int] = []
        self.from_host: list[int] = []
        self.to_host: list[int] = []
        self.cycles = 0
        self.registers.update({RCC: HSI_ON, RCC + 4: 0x24003010, PWR: 1 << 14})  # out of reset
        self.clocked = {RCC + 0x30: 0, RCC + 0x40: 0}
        self.supply_is_low, self.low_before = False, False
        self.reload_in_force, self.reload_looks, self.fed_with = 0xFFF, 3, 0
        self.pending = 0

    @property
    def system_hz(self) -> float:
        """Of the processor's clock, by what the clock registers say (RM0090, 7.2)."""
        control, pll = self.registers[RCC], self.registers[RCC + 4]
        of = INTERNAL_HZ
        if self.registers.get(RCC + 8, 0) & 3 == 1:
            of = CRYSTAL_HZ
        if self.registers.get(RCC + 8, 0) & 3 == 2:
            of = CRYSTAL_HZ if pll >> 22 & 1 else INTERNAL_HZ
            assert control & PLL_ON
            of = of / (pll & 63) * (pll >> 6 & 511) / (2 * (pll >> 16 & 3) + 2)
        return of

    def _take_clock(self, address: int, value: int) -> None:
        """RCC's control, factors and switch take only what the chip would (RM0090, 7.3.1 to 7.3.3)."""
        before = self.registers.get(address, 0)
        source = self.registers.get(RCC + 8, 0) & 3
        if address == RCC:
            kept = (HSI_ON, HSE_ON, PLL_ON)[source] | (
                HSE_ON if source == 2 and self.registers[RCC + 4] >> 22 & 1 else 0
            )
            value = value & ~READY | before & kept  # what is in use stays on
            if before & HSE_ON:
                value = value & ~HSE_BYPASSED | before & HSE_BYPASSED
        elif address == RCC + 4 and self.registers[RCC] & PLL_ON:
            value = before
        elif address == RCC + 8 and value & 3 == 2:
            hz = (CRYSTAL_HZ if self.registers[RCC + 4] >> 22 & 1 else INTERNAL_HZ) / (self.registers[RCC + 4] & 63)
            assert 1e6 <= hz <= 2e6, "the PLL's input is from 1 to 2 MHz"
            assert self.registers.get(FLASH, 0) & 15 >= 5, "the flash is slow enough for a fast clock"
            if not self.get(RCC) >> 25 & 1:
                value = value & ~3 | source
        self.registers[address] = value

    def get(self, address: int) -> int:
        """What the processor reads."""
        if address == RCC:
            control = self.registers.get(RCC, 0)
            ready = (control & 1 << 16) << 1 if self.crystal_works else 0
            locked = control & PLL_ON and (not self.registers[RCC + 4] >> 22 & 1 or ready)
            return control | ready | (control & HSI_ON) << 1 | (PLL_ON << 1 if locked else 0)
        port, offset = PORTS.get(address & ~0x3FF), address & 0x3FF
        if port and offset == IN:
            if port == "C" and self.input.busy:
                self.input.busy -= 1
                return 1 << 7
            return 0
        self._require_clock(address)
        if address in self.clocked:
            self.clocked[address] = self.registers.get(address, 0)
        if address == PWR + 4:
            return 4 * self._watch_supply()
        if address == IWDG + 0x0C:
            self.reload_looks = max(self.reload_looks - 1, 0)
            if not self.reload_looks:
                self.reload_in_force = self.registers.get(IWDG + 8, 0xFFF)
            return 3 if self.reload_looks else 0
        if address == SPI2 + 8:
            return 0 if self.spi_stands else 2 | bool(self.received)
        if address == SPI2 + 0x0C:
            return self.received.pop(0)
        if address == RCC + 8:
            return self.registers.get(address, 0) | (self.registers.get(address, 0) & 3) << 2
        if address == USART3:
            return 1 << 7 | (1 << 5 if self.from_host else 0)
        if address == USART3 + 4:
            return self.from_host.pop(0)
        if address == DWT + 4:
            return self.cycles
        if address == SYSTICK:  # a read takes the mark of a wrap back
            control = self.registers.get(SYSTICK, 0)
            self.registers[SYSTICK] = control & ~WRAPPED
            return control
        return self.registers.get(address, 0)

    def set(self, address: int, value: int) -> None:
        """What the processor writes."""
        port, offset = PORTS.get(address & ~0x3FF), address & 0x3FF
        self._require_clock(address)
        if address in (RCC, RCC + 4, RCC + 8):
            self._take_clock(address, value)
            return
        if address == EXTI + 0x14:
            self.pending &= ~value
            return
        if address == IWDG and value == 0xAAAA:
            self.fed_with = self.reload_in_force
        self.registers[address] = value
        self._watch_supply()
        if port and offset == SET:
            for n in range(16):
                if value >> n & 1:
                    self._move(f"{port}{n}", 1)
                elif value >> (16 + n) & 1:
                    self._move(f"{port}{n}", 0)
        elif address == DWT + 4:
            self.cycles = value
        elif address == USART3 + 4:
            self.to_host.append(value)
        elif address == SYSTICK + 8:  # any write clears
            self.registers[address] = 0
        elif port and offset == MODE:
            for n in range(16):
                self.moved.append(("mode", f"{port}{n}", value >> (2 * n) & 3))
        elif address == SPI2 + 0x0C and not self.spi_stands:
            control = self.registers[SPI2]
            assert control & 0x47 == 0x46, "SPI: on, master, idle high, data at the first edge"
            selected = [chip for pin, chip in (("B8", self.input), ("C3", self.output)) if self.pins.get(pin) == 0]
            assert len(selected) == 1, "one chip is spoken to"
            self.received.append(selected[0].exchange(value))

    def passes(self, clocks: int) -> None:
        """Time goes by: the debug unit counts where it is powered and its counter is on (Armv7-M, C1.8)."""
        if self.registers.get(DEMCR, 0) >> 24 & 1 and self.registers.get(DWT, 0) & 1:
            self.cycles = self.cycles + clocks & 0xFFFFFFFF

    def _require_clock(self, address: int) -> None:
        """A peripheral is out of reach until its clock has been switched on, and has ticked twice: read back here."""
        switch = CLOCKED.get(address & ~0x3FF)
        if switch:
            assert self.clocked[RCC + switch[0]] & switch[1], f"{address:#x}: its clock is off, or has just come on"

    def _watch_supply(self) -> bool:
        """Whether the detector says the supply is low; its line pends where it rises (RM0090, 5.2.2, 12.2)."""
        low = bool(self.supply_is_low and self.registers.get(PWR, 0) >> 4 & 1)
        if low and not self.low_before and self.registers.get(EXTI + 8, 0) >> 16 & 1:
            self.pending |= 1 << 16
        self.low_before = low
        return low

    @property
    def supply_halts(self) -> bool:
        """Whether the supply's interrupt comes."""
        return bool(self.pending & self.registers.get(EXTI, 0) & 1 << 16 and self.registers.get(NVIC, 0) & 2)

    def _move(self, pin: str, level: int) -> None:
        before, self.pins[pin] = self.pins.get(pin), level
        self.moved.append(("pin", pin, level))
        fell, rose = before == 1 and level == 0, before == 0 and level == 1
        if pin == "C6" and rose and not self.pins.get("B9"):
            self.input.convert()
        if pin == "B8" and fell:
            self.input.select()
        if pin == "C3" and (fell or rose):
            (self.output.select if fell else self.output.deselect)()
        if pin == "C2" and fell:
            self.output.load()
        if pin == "A5":
            self.output.clear(level == 0)


def build(folder: Path, baud: int = 2_000_000) -> ctypes.CDLL:
    """The board's program for this machine, its registers left to a model."""
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")[0]
    (folder / "stub.c").write_text(STUB)
    library = folder / "drivers.so"
    paths = [str(FIRMWARE / name) for name in SOURCES]
    paths += [str(path) for path in (ROOT / "core").rglob("*.c") if path.parent.name not in {"display", "host"}]
    flags = ["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-DTACT_MODELLED"]
    flags += ["-Dmain=tact_main", '-DTACT_BOARD_NAME="stm32f405"', "-DTACT_STREAM_ROWS=1024", "-DTACT_TRACE_ROWS=1024"]
    flags += ["-ffp-contract=off", f"-DTACT_BAUD={baud}", f"-I{ROOT / 'core'}", f"-I{FIRMWARE}"]
    subprocess.run([compiler, *flags, *paths, str(folder / "stub.c"), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


GET = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_uint32)
SET_CALL = ctypes.CFUNCTYPE(None, ctypes.c_uint32, ctypes.c_uint32)


class Drivers:
    """The drivers, on a chip of the model; `call` raises what the model objects to."""

    def __init__(self, library: ctypes.CDLL, chip: Chip) -> None:
        self.compiled, self.chip = library, chip
        self.objections: list[BaseException] = []

        def get(address: int) -> int:
            try:
                return chip.get(address)
            except BaseException as error:
                self.objections.append(error)
                return 0

        def set_(address: int, value: int) -> None:
            try:
                chip.set(address, value)
            except BaseException as error:
                self.objections.append(error)

        self._calls = (GET(get), SET_CALL(set_))
        for name, call in zip(("model_get", "model_set"), self._calls, strict=True):
            ctypes.c_void_p.in_dll(library, name).value = ctypes.cast(call, ctypes.c_void_p).value

    def call(self, name: str, *arguments: object) -> int:
        """One function of the drivers."""
        answer = int(getattr(self.compiled, name)(*arguments))
        if self.objections:
            raise self.objections[0]
        return answer
