"""The STM32F405's drivers against a model of its registers and of the chips around it, by the makers' documents."""

import ctypes

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware import chip_model as model
from tests.firmware.chip_model import Chip, Drivers, build

CODES = st.lists(st.integers(-32768, 32767), min_size=3, max_size=3)
STOPS_WHERE_HOT, LIMITS_CURRENT = 1 << 3, 1 << 2
"""Of the control register (data sheet of the AD5754R)."""
A_D, D_A, CRYSTAL = 2, 4, 1
LSI_HZ = (17e3, 47e3)
"""The watchdog's oscillator, least and most (data sheet of the chip)."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return build(tmp_path_factory.mktemp("drivers"))


def drivers(library: ctypes.CDLL, chip: Chip | None = None) -> Drivers:
    made = Drivers(library, chip or Chip())
    made.call("tact_bus_begin")
    return made


def three(codes: list[int]) -> ctypes.Array[ctypes.c_int32]:
    return (ctypes.c_int32 * 3)(*codes)


def test_bus__begin__outputs_are_safe_before_a_pin_drives_anything(library):
    chip = drivers(library).chip
    assert (chip.pins["A4"], chip.pins["A5"]) == (0, 0)
    for pin in ("A4", "A5", "B8", "B9", "C2", "C3", "C6"):
        level = chip.moved.index(next(move for move in chip.moved if move[:2] == ("pin", pin)))
        drives = chip.moved.index(("mode", pin, 1))
        assert level < drives


@given(CODES)
def test_ad5754__codes__are_volts_at_the_outputs_all_at_one_instant(library, codes):
    on = drivers(library)
    assert on.call("tact_ad5754_begin") == 1
    on.call("tact_bus_outputs_on")
    before = len(on.chip.moved)
    assert on.call("tact_ad5754_write", three(codes), 3) == 1
    assert on.chip.output.volts[:3] == [code * model.STEP_V for code in codes]
    assert on.chip.output.volts[3] == 0.0
    assert [move for move in on.chip.moved[before:] if move == ("pin", "C2", 0)] == [("pin", "C2", 0)]


@given(CODES)
def test_outputs_safe__whatever_was_put_out__is_zero_volts_by_one_store(library, codes):
    on = drivers(library)
    on.call("tact_ad5754_begin")
    on.call("tact_bus_outputs_on")
    on.call("tact_ad5754_write", three(codes), 3)
    assert on.chip.pins["A4"] == 1
    before = len(on.chip.moved)
    on.call("tact_bus_outputs_safe")
    assert on.chip.output.volts == [0.0] * 4
    assert on.chip.pins["A4"] == 0
    assert on.chip.registers[0x40020018] == 1 << 20 | 1 << 21
    assert len(on.chip.moved) == before + 2
    on.call("tact_ad5754_write", three(codes), 3)
    assert on.chip.output.volts == [0.0] * 4
    on.call("tact_bus_outputs_on")
    assert on.chip.output.volts == [0.0] * 4


@given(st.lists(st.floats(-11.0, 11.0), min_size=8, max_size=8))
def test_ad7606__volts__are_codes_of_the_instant_it_was_asked(library, volts):
    chip = Chip()
    chip.input.volts = volts
    on = drivers(library, chip)
    on.call("tact_ad7606_begin")
    codes = three([0, 0, 0])
    assert on.call("tact_ad7606_read", codes, 3) == 1
    assert list(codes) == [max(-32768, min(32767, round(v / model.STEP_V))) for v in volts[:3]]


def test_converters__that_do_not_convert__are_told_and_no_code_comes(library):
    chip, codes = Chip(), three([7, 8, 9])
    on = drivers(library, chip)
    for chip.input.busy_looks in (None, 10**9):  # it never begins, it never ends
        assert on.call("tact_ad7606_read", codes, 3) == 0
        assert (list(codes), chip.pins["C6"]) == ([7, 8, 9], 0)
    chip.spi_stands, chip.input.busy_looks = True, 5
    assert on.call("tact_ad5754_write", three([1, 2, 3]), 3) == 0
    assert on.call("tact_ad7606_read", codes, 3) == 0
    assert (chip.pins["B8"], chip.pins["C3"]) == (1, 1)


@pytest.mark.parametrize(
    "spoilt",
    [{"is_there": False}, {"ranges": [0, 4, 4, 4]}, {"power": 0}, {"alerts": 1 << 5}, {"alerts": 1 << 8}],
    ids=["gone", "range lost", "power lost", "too hot", "too much current"],
)
def test_ad5754__no_longer_as_it_was_set__is_found_out(library, spoilt):
    on = drivers(library)
    assert on.call("tact_ad5754_begin") == 1
    assert (on.chip.output.settings, on.chip.output.ranges) == (STOPS_WHERE_HOT | LIMITS_CURRENT, [4] * 4)
    assert on.call("tact_ad5754_is_sound") == 1
    vars(on.chip.output).update(spoilt)
    assert on.call("tact_ad5754_is_sound") == 0


def converters(library, chip):
    """The board's converters begun, and what it says of them."""
    on = drivers(library, chip)
    return on, on.call("tact_chip_converters", 3)


@pytest.mark.parametrize("is_there", [True, False])
def test_converters__with_a_d_a_or_none__begin_where_it_is(library, is_there):
    chip = Chip()
    chip.output.is_there = is_there
    on, missing = converters(library, chip)
    assert (missing, on.call("tact_chip_is_sound")) == (0 if is_there else D_A, is_there)


def test_converters__d_a_that_resets_itself__is_found_out_within_64_ticks(library):
    on, _ = converters(library, Chip())
    vars(on.chip.output).update(ranges=[0] * 4, power=0)
    for _ in range(64):
        on.call("tact_chip_put_out", three([0, 0, 0]))
    assert on.call("tact_chip_is_sound") == 0
    on.chip.input.busy_looks = None
    codes = three([0, 0, 0])
    on.call("tact_chip_read_in", codes)
    assert list(codes) == [32767] * 3


def test_clock__crystal__is_168_mhz_and_without_one_it_is_told(library):
    on = drivers(library)
    order: list[int] = []
    kept = on.chip.set
    on.chip.set = lambda address, value: (order.append(address), kept(address, value))[1]
    assert on.call("tact_chip_clock") == 0
    pll, bus = on.chip.registers[model.RCC + 4], on.chip.registers[model.RCC + 8]
    assert pll >> 22 & 1
    fast_hz = model.CRYSTAL_HZ / (pll & 63) * (pll >> 6 & 511)
    assert 1e6 <= model.CRYSTAL_HZ / (pll & 63) <= 2e6
    assert 100e6 <= fast_hz <= 432e6
    assert fast_hz / (2 * (pll >> 16 & 3) + 2) == 168e6
    assert (bus & 3, bus >> 10 & 7, bus >> 13 & 7) == (2, 5, 4)
    assert on.chip.registers[model.FLASH] & 15 == 5
    assert order.index(model.FLASH) < len(order) - 1 - order[::-1].index(model.RCC + 8)
    on.chip.passes(700)
    assert on.call("tact_chip_cycles") == 700
    chip = Chip()
    chip.crystal_works = False
    assert drivers(library, chip).call("tact_chip_clock") == CRYSTAL
    assert chip.system_hz == 168e6  # from the oscillator inside


def test_watchdog__slowest_and_fastest_oscillator__between_6_and_18_ms(library):
    on = drivers(library)
    keys = []
    kept = on.chip.set
    on.chip.set = lambda address, value: (keys.append((address - model.IWDG, value)), kept(address, value))[1]
    on.call("tact_watchdog_start")
    assert keys == [(0, 0xCCCC), (0, 0x5555), (4, 0), (8, on.chip.registers[model.IWDG + 8]), (0, 0xAAAA)]
    assert on.chip.fed_with == on.chip.registers[model.IWDG + 8]  # not the 0xFFF of a reset: it would wait for a second
    longest, shortest = (1e3 * 4 * (on.chip.registers[model.IWDG + 8] + 1) / hz for hz in LSI_HZ)
    assert shortest > 6.0
    assert longest < 18.0


def test_usart__2_megabaud_and_bytes_in_order_either_way_as_many_as_the_ring_holds(library):
    on = drivers(library)
    on.call("tact_usart_begin")
    assert 42_000_000 / on.chip.registers[model.USART3 + 8] == 2_000_000
    assert on.chip.registers[0x40020400 + model.MODE] >> 20 & 15 == 0b1010
    for length in (3, 8192, 9000):
        on.chip.from_host = [n % 251 for n in range(length)]
        while on.chip.from_host:
            on.call("tact_usart")
        taken = ctypes.create_string_buffer(16384)
        size = on.call("tact_usart_receive", taken, ctypes.c_size_t(16384))
        assert size == min(length, 8192)
        assert taken.raw[:size] == bytes(n % 251 for n in range(size))
    on.call("tact_usart_send", taken, ctypes.c_size_t(3000))
    assert bytes(on.chip.to_host) == taken.raw[:3000]


def test_supply__below_2_9_v__interrupts(library):
    """RM0090: PLS of 7 is 2.9 V, the least at which the converters' own supply of 3.3 V is sound; the watch is line 16,
    which rises when the supply falls; interrupt 1."""
    on = drivers(library)
    before = dict(on.chip.registers)
    on.call("tact_supply_watch")
    after = on.chip.registers
    assert after[model.RCC + 0x40] & ~before[model.RCC + 0x40] == 1 << 28
    assert after[model.PWR] >> 4 & 0b1111 == 0b1111
    assert (after[model.EXTI], after[model.EXTI + 0x08], after.get(model.EXTI + 0x0C, 0)) == (1 << 16, 1 << 16, 0)
    assert after[model.NVIC] == 1 << 1


TICK = ctypes.CFUNCTYPE(None)


@pytest.mark.parametrize(("late", "misses"), [(0, 0), (41_998, 0), (100, 1)])
def test_systick__late_or_missed__is_told_in_256ths_of_a_period(library, late, misses):
    """Counts down from 41,999; a wrap while the step runs is a tick that nobody gets, told with the next."""
    told, on = [], drivers(library)

    def step():
        told.append(on.compiled.tact_systick_lateness())
        if len(told) <= misses:
            on.chip.registers[model.SYSTICK] |= model.WRAPPED

    tick = TICK(step)
    on.call("tact_systick_start", ctypes.c_uint32(42_000), tick)
    assert on.chip.registers[model.SYSTICK + 4] == 41_999
    assert on.chip.registers[model.SYSTICK] == 7
    assert on.chip.registers[0xE000ED20] >> 24 == 0x80
    for _ in range(misses + 2):
        on.chip.registers[model.SYSTICK] |= model.WRAPPED  # the wrap that brings it
        on.chip.registers[model.SYSTICK + 8] = 41_999 - late
        on.call("tact_systick")
    share = late * 256 // 42_000
    assert told == [share, *[share + 256] * misses, share]
