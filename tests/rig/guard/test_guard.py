"""The guard trips, names and clears what is amiss; a period commands what its controllers say, to the bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.model.description import Display, Environment
from tactuator.rig.board.link import Mode
from tactuator.runtime._core import ffi, lib
from tactuator.runtime.safety_table import Fault
from tactuator.signals.discretise import discretise
from tactuator.signals.systems import ContinuousSystem
from tests.rig.guard.guarded import Guarded, designed, spoilt
from tests.runtime.paper_display import changed, controller
from tests.synthesis.displays import channel as finger

TRAVEL_MM = 12.5
QUARTER_S = 1000
SOFT = 410


def three(samples):
    return np.stack([samples] * 3, axis=1)


@pytest.mark.parametrize(
    ("sensor", "allowed"),
    [
        ("open", {Fault.SENSOR_OPEN}),
        ("shorted", {Fault.SENSOR_SHORTED}),
        ("frozen", {Fault.SENSOR_FROZEN}),
        ("reversed", {Fault.SENSOR_REVERSED, Fault.SENSOR_DISAGREES}),
    ],
)
@pytest.mark.parametrize("amplitude", [0.0, 100.0])
def test_sensor__fails__is_named_and_every_command_is_at_zero_within_250_ms_of_it(sensor, allowed, amplitude):
    """From the fault itself, not from its notice: 132 ms of a reversed sensor in silence, then two ramps."""
    guarded = Guarded(designed())
    rows = three(amplitude * np.sin(2.0 * np.pi * 7.0 * np.arange(2000) / 4000.0))
    assert guarded.run(rows[: SOFT + 200]).fault is Fault.NONE
    guarded.break_sensor(sensor)
    run = guarded.run(rows[SOFT + 200 :])
    assert run.fault in allowed or amplitude
    assert np.max(np.abs(run.command_v[QUARTER_S:])) < 1e-3
    assert np.max(np.abs(run.displacement_mm)) < 0.5 * TRAVEL_MM


def test_stopping_distance__full_command__is_cut_within_a_millisecond():
    guarded = Guarded(designed(), drives=True)
    guarded.run(np.zeros((SOFT, 3)))
    run = guarded.run(np.full((600, 3), 10.0))
    assert run.fault in (Fault.COMFORT, Fault.TRAVEL)  # whichever is passed first names it
    gone = int(np.argmax(run.command_v[run.fault_at :, 0] == 0.0)) + run.fault_at
    assert run.command_v[gone - 1, 0] > 3.0  # from full force to nothing in one tick, whatever ramp had begun
    assert np.all(run.command_v[gone:, 0] == 0.0)
    assert np.max(np.abs(run.displacement_mm)) < TRAVEL_MM


def test_reference__no_number_or_200_db__is_limited_on_the_board():
    guarded = Guarded(designed())
    rows = np.zeros((SOFT + 800, 3))
    rows[SOFT:] = np.nan, np.inf, 1e10
    run = guarded.run(rows)
    assert np.all(np.isfinite(run.command_v))
    assert np.max(np.abs(run.displacement_mm)) < TRAVEL_MM


def test_command__not_a_number_when_driven__is_a_named_fault():
    guarded = Guarded(designed(), drives=True)
    guarded.run(np.zeros((SOFT, 3)))
    assert guarded.run(np.full((10, 3), np.nan)).fault is Fault.NOT_A_NUMBER


@pytest.mark.parametrize(("lateness", "heard", "fault"), [(100, True, Fault.LATE), (0, False, Fault.SILENCE)])
def test_time__late_or_silent__fades_out_and_is_named(lateness, heard, fault):
    guarded = Guarded(designed())
    tone = three(50.0 * np.sin(np.arange(SOFT + 4000) * 0.05))
    guarded.run(tone[:SOFT])
    run = guarded.run(tone[SOFT : SOFT + 2400], lateness=lateness, heard=heard)
    assert run.fault is fault
    assert np.max(np.abs(run.command_v[run.fault_at + QUARTER_S :])) < 1e-3
    assert np.max(np.abs(np.diff(run.displacement_mm, axis=0))) < 0.2


@pytest.fixture(scope="module")
def safety():
    """The index finger's limits, but for comfort."""
    channel = ffi.new("tact_safety_channel *", Guarded(designed()).board.safety.channel[0])  # a copy
    channel.comfort_max, channel.frozen_ticks = 1e5, lib.TACT_SAFETY_NEVER
    return channel


def guard():
    """A guard at rest."""
    state = ffi.new("tact_guard_state *")
    lib.tact_guard_reset(state, 0)
    return state


@given(seed=st.integers(0, 2**32 - 1), turns=st.sampled_from([1, 3]), share=st.floats(-1.5, 1.5))
@settings(max_examples=30, deadline=None)
def test_reversal__any_motion__is_told_by_means_over_forty_turns(safety, seed, turns, share):
    """Against the two means as docs/safety.md defines them, in double precision; too close to call is not asked."""
    state, rng = guard(), np.random.default_rng(seed)
    step_v, agreement, power, code = safety.converter.step_v_single, 0.0, 0.0, 1000
    state.compared_v = code * step_v
    for turn in range(200):
        w = float(np.float32(rng.normal() * 10.0 ** rng.uniform(-5.0, -2.0)))
        codes = round(share * turns * w / step_v)
        code += codes
        state.w, state.last_code = w, code
        faults = lib.tact_guard_compare(safety, state, turns, turn)
        agreement += 0.025 * (turns * w * step_v * codes - agreement)
        power += 0.025 * ((turns * w) ** 2 - power)
        near = min(abs(power / safety.reversal_power - 1.0), abs(agreement / (-0.5 * power) - 1.0))
        if near > 1e-3:
            is_reversed = power > safety.reversal_power and agreement < -0.5 * power
            assert bool(faults & (1 << Fault.SENSOR_REVERSED)) == is_reversed


@pytest.mark.parametrize(("ticks", "faults"), [("NEVER", 0), (50, 1 << Fault.SENSOR_FROZEN)])
def test_frozen__a_reading_that_stays__is_a_fault_unless_it_may_for_ever(safety, ticks, faults):
    channel = ffi.new("tact_safety_channel *", safety[0])
    channel.frozen_ticks = lib.TACT_SAFETY_NEVER if ticks == "NEVER" else ticks
    state = guard()
    state.last_code, state.compared_v = 1000, 1000 * channel.converter.step_v_single
    state.x = state.compared_v
    assert lib.tact_guard_compare(channel, state, 3, 49) == 0
    assert lib.tact_guard_compare(channel, state, 3, lib.TACT_SAFETY_NEVER + 1) == faults


def falls_over():
    """Three motors without friction that fall over by themselves, as a magnet does that lifts; the loop's gain at rest
    is -5."""
    own = {"plant": ContinuousSystem([], [60.0, -60.0], 4000.0), "environment": Environment(friction_v=0.0)}
    channels = tuple(finger(name, loads=(), **own) for name in ("index", "thumb", "middle"))
    sections = discretise(ContinuousSystem([-60.0], [-3000.0], 225.0), 4000.0, "bilinear").sections()
    return changed(controller(Display(4000.0, channels, 1, "magnets")), feedback_sos=sections)


def test_guard__plant_that_falls_over__is_ended_below_the_least_gain():
    """A command at its limit is a loop of lower gain, which grows there: the travel is not reached before the end."""
    made, least = falls_over(), 1.0 / 5.0
    rows = three(10.0 * np.sin(2.0 * np.pi * 5.0 * np.arange(6000) / 4000.0))
    for share, ends in ((1.0, False), (1.2 * least, False), (0.9 * least, True), (0.1 * least, True)):
        run = Guarded(spoilt(made, share)).run(rows)
        assert (run.fault in {Fault.COMFORT, Fault.TRAVEL}) == ends, (share, least, run.fault)
        assert np.max(np.abs(run.displacement_mm[: run.fault_at and run.fault_at + 1])) < TRAVEL_MM


def answers(guarded, rows):
    """What the board put into its queue at every tick, and what the controllers say; until it is in a fault."""
    board, simulated = guarded.board, guarded.simulated
    states = [ffi.new("tact_controller_state *") for _ in range(3)]
    for c, state in enumerate(states):
        lib.tact_controller_reset(ffi.addressof(board.image.controller, c), state)
    found, wanted = [], []
    for row in np.asarray(rows, dtype=np.float32):
        fade, command_fade, slot = np.float32(board.fade), np.float32(board.command_fade), board.delay_at
        lib.tact_board_stream(board, board.tick, ffi.from_buffer("float[]", np.ascontiguousarray(row)), 1)
        board.silence = 0
        lib.tact_simulated_board_period(simulated, board, 0)
        for c, state in enumerate(states):
            safety, channel = board.safety.channel[c], board.channel[c]
            most = np.float32(safety.reference_max)
            reference = fade * np.clip(row[c], -most, most)
            position_v = lib.tact_converter_position_v(ffi.addressof(safety.converter), simulated.code[c])
            command_v = lib.tact_controller_step(ffi.addressof(board.image.controller, c), state, reference, position_v)
            found.append(channel.delayed_v[slot])
            wanted.append(float(command_fade * np.float32(command_v)))
        if board.mode != lib.TACT_RUNNING:
            break
    return np.array(found), np.array(wanted)


def test_period__tones_silence_and_limits__commands_are_the_controllers_to_the_bit():
    guarded = Guarded(designed())
    time_s = np.arange(SOFT + 1500) / 4000.0
    rows = np.stack([150.0 * np.sin(2.0 * np.pi * f * time_s) for f in (3.0, 31.0, 187.0)], axis=1)
    rows[SOFT + 700 : SOFT + 900] = 0.0
    found, wanted = answers(guarded, rows)
    assert guarded.board.mode == lib.TACT_RUNNING
    assert np.array_equal(found, wanted)
    guarded = Guarded(spoilt(designed(), 3.0))
    found, wanted = answers(guarded, np.full((SOFT, 3), 1e9) * np.sign(np.sin(np.arange(SOFT) * 2.5))[:, None])
    assert any(guarded.board.channel[c].controller.clamped for c in range(3))
    before = slice(0, found.size - 3)  # a fault's own tick empties the queue
    assert np.array_equal(found[before], wanted[before])


def test_guard__armed_and_moved_by_hand__is_no_fault_but_a_sensor_that_lies_is():
    guarded = Guarded(designed())
    guarded.leave()
    guarded.run(np.zeros((1000, 3)))
    assert guarded.mode is Mode.ARMED
    by_hand = (Fault.TRAVEL, Fault.COMFORT, Fault.SENSOR_STUCK)
    lib.tact_board_fail(guarded.board, sum(1 << fault for fault in by_hand), 0)
    assert guarded.mode is Mode.ARMED
    lib.tact_board_fail(guarded.board, 1 << Fault.SENSOR_OPEN, 0)
    assert Fault(guarded.board.fault) is Fault.SENSOR_OPEN
