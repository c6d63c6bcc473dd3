"""The very program that is flashed, run by Unicorn's Cortex-M4 on the model of the chip (chip_model.py).

Unicorn has the processor's instructions and registers, no interrupts and no devices. An interrupt is taken here as
Armv7-M does (B1.5): between two instructions where no mask keeps it out, through the table that VTOR points to, on the
stack that is in use. Nothing waits for a clock: the program runs until it sleeps, then bytes and ticks come.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_HOOK_INTR, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError
from unicorn import arm_const as arm

from tests.firmware import chip_model as model
from tests.firmware.chip_model import Chip

FLASH, FLASH_BYTES, RAM, RAM_BYTES = 0x08000000, 1 << 20, 0x20000000, 128 << 10
DEVICES, SYSTEM = (0x40000000, 0x00080000), (0xE0000000, 0x00100000)
RETURNS, TOP_OF_DIRT = 0xFFFFFFF8, 0x20001000
HARD_FAULT, SYSTICK, SUPPLY, USART = 3, 15, 16 + 1, 16 + 39
SYSTICK_RUNS, MOST_TICKS = 7, 8
WAITS_FOR_INTERRUPT, LETS_INTERRUPTS_IN = b"\x30\xbf", b"\x62\xb6"
IN_THE_LAST_LOOP = 1000
"""Instructions: more than it takes to make the outputs safe."""
LEAVES = 8
"""Unicorn's number for the return from an exception."""
STACKED = (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3, arm.UC_ARM_REG_R12,
           arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC, arm.UC_ARM_REG_XPSR)  # fmt: skip
MASKS = (arm.UC_ARM_REG_PRIMASK, arm.UC_ARM_REG_FAULTMASK, arm.UC_ARM_REG_BASEPRI)


def addresses(program: Path) -> dict[str, int]:
    """Of a program's functions, without the bit of Thumb."""
    said = subprocess.run(["arm-none-eabi-nm", str(program)], check=True, capture_output=True, text=True).stdout
    rows = (line.split() for line in said.splitlines() if line[0] != " ")
    return {name: int(address, 16) & ~1 for address, _, name in rows}


class Processor:
    """A processor with `program` (ELF) in its flash, on `chip`: out of reset, or (`after_bootloader`) entered by one
    that runs on the process stack with everything masked and has written all over the RAM. A transport of the link.

    halted: it has reached the loop that ends everything.
    """

    def __init__(self, program: Path, chip: Chip, after_bootloader: bool = False) -> None:
        self.chip, self.at, self.halted = chip, addresses(program), False
        self._wrong: list[BaseException] = []
        self._uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self._uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        self._lay_out(program)
        end = self.at["tact_halt_here"]
        self._uc.hook_add(UC_HOOK_CODE, self._halts, begin=end, end=end)
        self._uc.hook_add(UC_HOOK_INTR, self._leaves_or_faults)
        if after_bootloader:
            self._uc.mem_write(RAM, b"\xa5" * RAM_BYTES)
            chip.registers[model.VTOR] = 0x1FFF0000
            for register, value in zip(MASKS, (1, 1, 0x10), strict=True):
                self._uc.reg_write(register, value)
            self._uc.reg_write(arm.UC_ARM_REG_CONTROL, 2)
        self._uc.reg_write(arm.UC_ARM_REG_SP, TOP_OF_DIRT if after_bootloader else self._word(FLASH))
        self._run(self._word(FLASH + 4))

    def _lay_out(self, program: Path) -> None:
        binary = program.with_suffix(".as-flashed.bin")
        subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", str(program), str(binary)], check=True)
        content = binary.read_bytes()
        for begins, size in ((0, FLASH_BYTES), (FLASH, FLASH_BYTES), (RAM, RAM_BYTES)):
            self._uc.mem_map(begins, size)
        for begins in (0, FLASH):  # BOOT0 low: the flash is at 0 as well
            self._uc.mem_write(begins, content)
        for begins, size in (DEVICES, SYSTEM):
            read = self._guarded(lambda offset, begins=begins: self.chip.get(begins + offset))
            write = self._guarded(lambda offset, value, begins=begins: self.chip.set(begins + offset, value))
            self._uc.mmio_map(
                begins, size, lambda uc, offset, size, _, read=read: read(offset), None,
                lambda uc, offset, size, value, _, write=write: write(offset, value), None,
            )  # fmt: skip

    def _guarded(self, call: Callable[..., int | None]) -> Callable[..., int]:
        """What the model objects to ends the run, and is raised there."""

        def guarded(*given: int) -> int:
            try:
                return (call(*given) or 0) & 0xFFFFFFFF
            except BaseException as error:
                self._wrong.append(error)
                self._uc.emu_stop()
                return 0

        return guarded

    # -- the processor ------------------------------------------------------------------------------------------------

    def _word(self, address: int) -> int:
        return int.from_bytes(self._uc.mem_read(address, 4), "little")

    def _halts(self, *_: object) -> None:
        """Stop before the loop that nothing ends; what it does first is run by `_run`."""
        if not self.halted:
            self._uc.emu_stop()
        self.halted = True

    def _leaves_or_faults(self, _: Uc, number: int, __: object) -> None:
        if number != LEAVES:
            at = self._uc.reg_read(arm.UC_ARM_REG_PC)
            self._wrong.append(AssertionError(f"exception {number} at {at:#x}"))
        self._uc.emu_stop()

    def _run(self, address: int, until: int = 0xFFFFFFFE) -> None:
        """Run from an address to where it sleeps, comes to `until`, or is halted."""
        try:
            self._uc.emu_start(address | 1, until)
            if self.halted:
                self._uc.emu_start(self.at["tact_halt_here"] | 1, until, count=IN_THE_LAST_LOOP)
        except UcError as error:
            self._wrong.append(error)
        if self._wrong:
            raise self._wrong[0]

    def _wakes(self) -> None:
        """Carry out the instruction behind the sleep, which lets interrupts in: Unicorn does not come to it."""
        at = self._uc.reg_read(arm.UC_ARM_REG_PC) & ~1
        code = bytes(self._uc.mem_read(at - 2, 4))
        assert code == WAITS_FOR_INTERRUPT + LETS_INTERRUPTS_IN, f"it stopped at {at:#x}, {code.hex()}"
        self._uc.reg_write(arm.UC_ARM_REG_PRIMASK, 0)
        self._uc.reg_write(arm.UC_ARM_REG_PC, at + 2 | 1)
        assert not any(self._uc.reg_read(mask) for mask in MASKS), "nothing keeps interrupts out"

    def _interrupt(self, number: int) -> None:
        """Take an exception here, and come back from it."""
        assert self._uc.reg_read(arm.UC_ARM_REG_CONTROL) & 2 == 0, "the main stack is in use"
        kept = self._uc.context_save()
        sp = self._uc.reg_read(arm.UC_ARM_REG_SP) - 0x68 & ~7  # room for the floating-point registers as well
        for place, register in enumerate(STACKED):
            self._uc.mem_write(sp + 4 * place, self._uc.reg_read(register).to_bytes(4, "little"))
        self._uc.reg_write(arm.UC_ARM_REG_SP, sp)
        self._uc.reg_write(arm.UC_ARM_REG_LR, RETURNS | 1)
        vector = self._word(self.chip.registers.get(model.VTOR, 0) + 4 * number)
        self._run(vector, RETURNS)
        if not self.halted:
            self._uc.context_restore(kept)

    # -- time, and the link -------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Let some time pass: what has come interrupts, then the program runs until it sleeps again."""
        if self.halted:
            return
        self._wakes()
        if self.chip.supply_halts:
            self._interrupt(SUPPLY)
            return
        enabled = self.chip.registers.get(model.NVIC + 4, 0) >> 7 & 1
        while self.chip.from_host and enabled:
            self._interrupt(USART)
        for _ in range(MOST_TICKS):
            if self.chip.registers.get(model.SYSTICK, 0) & SYSTICK_RUNS == SYSTICK_RUNS:
                self.chip.registers[model.SYSTICK + 8] = self.chip.registers[model.SYSTICK + 4]
                self._interrupt(SYSTICK)
        self._run(self._uc.reg_read(arm.UC_ARM_REG_PC))

    def send(self, content: bytes) -> None:
        self.chip.from_host.extend(content)

    def receive(self, timeout_s: float) -> bytes:
        end_s = time.monotonic() + timeout_s
        while not self.chip.to_host and not self.halted and time.monotonic() < end_s:
            self.step()
        content, self.chip.to_host[:] = bytes(self.chip.to_host), []
        return content

    def close(self) -> None:
        if self._wrong:
            raise self._wrong[0]
