"""What every exported column means, and its unit: one dictionary for all formats."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Meaning:
    """unit: as written in the export, empty for words and counts."""

    name: str
    description: str
    unit: str = ""


TRIAL_COLUMNS: tuple[Meaning, ...] = (
    Meaning("study", "Name of the study"),
    Meaning("subject", "Code of the subject"),
    Meaning("subject_group", "hearing, hearing-impaired, simulated or unknown"),
    Meaning("experimenter", "Who ran the session"),
    Meaning("site", "Place on the finger that was stimulated"),
    Meaning("surround", "Surround of the contactor"),
    Meaning("contact_area_mm2", "Area of contact", "mm^2"),
    Meaning("skin_temperature_c", "Temperature of the skin", "degree Celsius"),
    Meaning("preload_n", "Static force of the finger", "N"),
    Meaning("masking_sound", "Sound that masks the noise of the display"),
    Meaning("masking_level_db_spl", "Level of the masking sound", "dB re 20 uPa"),
    Meaning("run", "Number of the run in the store"),
    Meaning("position", "Place of the run in the session, from 0"),
    Meaning("attempt", "Attempt at the run, from 0; a later one replaces those before"),
    Meaning("run_state", "done, running, restarted (lay too long and was begun again) or stopped (given up)"),
    Meaning("practice", "1 for practice, not to be analysed"),
    Meaning("paradigm", "What the subject was asked"),
    Meaning("procedure", "What placed the trials"),
    Meaning("finger", "Finger that was stimulated"),
    Meaning("rig", "What played the stimuli"),
    Meaning("display", "Name of the display"),
    Meaning("controller_sha256", "Hash of the display's controller"),
    Meaning("curve", "Threshold curve that 0 dB SL stands for"),
    Meaning("sensor_gain_v_per_mm", "Calibration of the position sensor", "V/mm"),
    Meaning("trial", "Number of the trial in its run, from 0"),
    Meaning("frequency_hz", "Frequency of the stimulus", "Hz"),
    Meaning("level_db_sl", "Commanded level of the stimulus", "dB re the threshold curve"),
    Meaning("curve_level_db_re_1um", "Level of the threshold curve at the frequency", "dB re 1 um peak"),
    Meaning("measured_db_sl", "Level at the sensor in the interval of the stimulus", "dB re the threshold curve"),
    Meaning("stimuli", "Labels of what the intervals played, in order, joined by a vertical bar"),
    Meaning("correct_response", "Response that was right"),
    Meaning("response", "Response that was given"),
    Meaning("correct", "1 where they agree"),
    Meaning("response_time", "From the end of the last interval to the response, by the client's clock", "s"),
    Meaning("presented_utc", "When the presentation began, server's clock, ISO 8601"),
    Meaning("received_utc", "When the response arrived, server's clock, ISO 8601"),
)
"""One row for each answered trial."""
