"""The verb `sound calibrate`: volts at full scale from a multimeter's reading."""

from __future__ import annotations

from rich.table import Table

from tactuator.cli.answer import answer, working
from tactuator.cli.sound.asking import asked_number
from tactuator.rig.open import open_rig
from tactuator.rig.sound.loopback import full_scale_v, tone, wire_display


def run(
    device: str,
    rate_hz: float,
    output: int,
    frequency_hz: float,
    level: float,
    duration_s: float,
    reading_v: float | None,
    input_number: int,
    as_json: bool,
) -> None:
    """Play a tone for a multimeter and turn its reading into volts at full scale."""
    if reading_v is not None:
        full_scale_v(reading_v, 1.0)  # what is no reading is refused before the tone is played
    told = f"{frequency_hz:g} Hz at output {output} for {duration_s:g} s: read the multimeter (V rms)"
    with open_rig(f"sound:{device}", wire_display(rate_hz, output, input_number)) as rig, working(told):
        heard = tone(rig, frequency_hz, level, duration_s)
    read = asked_number("what did the multimeter read, V rms? ") if reading_v is None else reading_v
    volts = full_scale_v(read, level)
    result: dict[str, object] = {"device": device, "output": output, "output_full_scale_v": volts}
    if input_number:
        result |= {"input": input_number, "input_full_scale_v": volts * level / heard}
    table = Table("key of [sound]", "value")
    for key, value in result.items():
        table.add_row(key, f"{value:.6g}" if isinstance(value, float) else str(value))
    answer(result, as_json, table)
