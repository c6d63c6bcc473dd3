"""Meaning and unit of every exported column: one dictionary for all formats."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column; unit: as written in the export, empty for words and counts."""

    name: str
    description: str
    unit: str = ""


_IDENTITY = (
    Meaning("study", "Name of the study"),
    Meaning("subject", "Code of the subject"),
    Meaning("visit", "Number of the visit, from 1"),
)
_RUN = Meaning("run", "Number of the run in the store")
_VERSION = Meaning("protocol_version", "Version of the study's protocol that the run is of")
_TRIAL = Meaning("trial", "Number of the trial in its run, from 0")
_PRESENTATION = (
    Meaning("respondent", "Who answered: person, simulated (an observer of the program), script, or unknown"),
    Meaning("rig_simulated", "1 where the display was simulated: nothing could be felt by a person there"),
    Meaning("shown", "What of the stimuli a person could see or hear in a demonstration; empty: nothing"),
)
_SIMULATED = Meaning("simulated", "simulated: a program answered, or the display was one, so that nobody felt it")

TRIAL_COLUMNS: tuple[Meaning, ...] = (
    *_IDENTITY,
    Meaning("subject_group", "Group, as the laboratory names it; simulated: nobody felt anything"),
    Meaning("experimenter", "Who ran the session"),
    Meaning("site", "Place on the finger that was stimulated"),
    Meaning("surround", "Surround of the contactor"),
    Meaning("contact_area_mm2", "Area of contact", "mm^2"),
    Meaning("skin_temperature_c", "Temperature of the skin on that day", "degree Celsius"),
    Meaning("preload_n", "Static force of the finger on that day", "N"),
    Meaning("masking_sound", "Sound that masks the noise of the display"),
    Meaning("masking_level_db_spl", "Level of the masking sound", "dB re 20 uPa"),
    Meaning("session_ended", "How the session ended before its time: withdrawn; empty where it did not"),
    _VERSION,
    _RUN,
    Meaning("position", "Place of the run in the session, from 0"),
    Meaning("attempt", "Attempt at the run, from 0; a later one replaces those before"),
    Meaning("run_state", "done, running, restarted (lay too long, or practice not passed) or stopped (given up)"),
    Meaning("practice", "1 for practice, not to be analysed"),
    Meaning("paradigm", "What the subject was asked"),
    Meaning("procedure", "What placed the trials"),
    Meaning("finger", "Finger that was stimulated"),
    *_PRESENTATION,
    Meaning("rig", "What played the stimuli"),
    Meaning("rig_rate_hz", "Rate of the rig's clock", "Hz"),
    Meaning("speed", "Speed of presentation: 1 is real time, empty as fast as the rig goes"),
    Meaning("display", "Name of the display"),
    Meaning("controller_sha256", "Hash of the display's controller"),
    Meaning("curve", "Threshold curve that 0 dB SL stands for"),
    Meaning("band_low_hz", "Lowest frequency that the display plays", "Hz"),
    Meaning("band_high_hz", "Highest frequency that the display plays", "Hz"),
    Meaning("sensor_gain_v_per_mm", "Calibration of the position sensor", "V/mm"),
    _TRIAL,
    Meaning("frequency_hz", "Frequency of the stimulus", "Hz"),
    Meaning("level_db_sl", "Commanded level of the stimulus", "dB re the threshold curve"),
    Meaning("curve_level_db_re_1um", "Level of the threshold curve at the frequency", "dB re 1 um peak"),
    Meaning("measured_db_sl", "Level at the sensor in the interval of the stimulus", "dB re the threshold curve"),
    Meaning("stimuli", "Labels of what the intervals played, in order, joined by a vertical bar"),
    Meaning("correct_response", "Response that was right"),
    Meaning("response", "Response that was given"),
    Meaning("correct", "1 where they agree"),
    Meaning("response_time", "From being asked to the response, by the page's own clock", "s"),
    Meaning("server_response_time", "From the end of the trial to the response, by the server's clock", "s"),
    Meaning("presentations", "How often the trial was played until it was answered"),
    Meaning("rig_tick", "Tick of the rig's run at which the trial's first sample was played"),
    Meaning("presented_utc", "When the presentation began, server's clock, ISO 8601"),
    Meaning("ended_utc", "When the presentation was over, server's clock, ISO 8601"),
    Meaning("received_utc", "When the response arrived, server's clock, ISO 8601"),
)
"""One row for each answered trial."""

INTERVAL_COLUMNS: tuple[Meaning, ...] = (
    *_IDENTITY,
    _RUN,
    _TRIAL,
    Meaning("interval", "Place of the interval in the trial, from 1"),
    Meaning("stimulus", "Label of what it played; blank: nothing"),
    Meaning("commanded_db_sl", "Commanded level; empty where nothing was commanded", "dB re the threshold curve"),
    Meaning("measured_db_sl", "Level at the sensor, at the frequency of the trial", "dB re the threshold curve"),
    Meaning("saturated", "1 where a converter or the command reached its limit, or the motion travel_mm"),
    Meaning("onset_s", "Onset from the trial's first sample, by the rig's own clock", "s"),
    Meaning("duration_s", "Duration, by the rig's own clock", "s"),
    Meaning("lamp_late_s", "How far the rig was past the onset when the lamp was told to light", "s"),
    Meaning("client_lit_ms", "When the page lit the lamp, by its own clock", "ms"),
    _SIMULATED,
)
"""One row for each interval of an answered trial."""

EVENT_COLUMNS: tuple[Meaning, ...] = (
    *_IDENTITY,
    Meaning("at_utc", "When it happened, server's clock, ISO 8601"),
    Meaning("who", "Whose doing it was: the operator's name, the subject, or tactuator"),
    Meaning(
        "kind", "break, pause, stop, resume, withdrawn, declined, restart, timing-missed, amended, day, correction, ..."
    ),
    Meaning("trials", "Answered trials of the session by then, where that counts"),
    Meaning("item", "Name of what was corrected, as the column that holds it is called"),
    Meaning("before", "What stood there before; empty: nothing"),
    Meaning("after", "What stands there since; empty: nothing"),
    Meaning("detail", "In words: of a correction, the reason"),
    _SIMULATED,
)
"""One row for each event."""

SUBJECT_COLUMNS: tuple[Meaning, ...] = (
    *_IDENTITY[:2],
    Meaning("subject_group", "Group, as the laboratory names it; simulated: nobody felt anything"),
    Meaning("outside_id", "What others call the subject"),
    Meaning("enrolled_utc", "When the subject was enrolled, ISO 8601"),
)
"""One row for each subject, with a column more for each demographic item of the protocol."""

THRESHOLD_COLUMNS: tuple[Meaning, ...] = (
    *_IDENTITY,
    Meaning("group", "Group, as the laboratory names it; simulated: nobody felt anything"),
    Meaning("finger", "Finger that was stimulated"),
    Meaning("frequency_hz", "Frequency of the stimulus", "Hz"),
    Meaning("procedure", "What placed the trials"),
    _VERSION,
    _RUN,
    Meaning("trials", "Trials of the run"),
    Meaning("point", "Share of right answers, lapses included, at the level that both thresholds stand for"),
    Meaning("own_db_sl", "Threshold as the procedure states it, commanded", "dB re the threshold curve"),
    Meaning("own_standard_error_db", "Its standard error", "dB"),
    Meaning("refit_db_sl", "Posterior median of the refit's threshold, commanded", "dB re the threshold curve"),
    Meaning("refit_sd_db", "Posterior standard deviation; empty where there is a bound", "dB"),
    Meaning("refit_low_db_sl", "Lower end of the 95 % interval; empty where it is open", "dB re the threshold curve"),
    Meaning("refit_high_db_sl", "Upper end of the 95 % interval; empty where it is open", "dB re the threshold curve"),
    Meaning("bound", ">= or <= where the threshold is censored: beyond the levels played, whose last is told"),
    Meaning("delivered_db", "What the sensor saw above the commanded level near threshold", "dB"),
    Meaning("delivered_sd_db", "Its standard deviation", "dB"),
    Meaning("own_level_db_re_1um", "The procedure's threshold as displacement, delivered", "dB re 1 um peak"),
    Meaning("level_db_re_1um", "The refit's threshold as displacement, delivered", "dB re 1 um peak"),
    Meaning(
        "level_low_db_re_1um",
        "Lower end of its 95 % interval with the delivered level's error; empty: open",
        "dB re 1 um peak",
    ),
    Meaning(
        "level_high_db_re_1um",
        "Upper end of its 95 % interval with the delivered level's error; empty: open",
        "dB re 1 um peak",
    ),
    Meaning("sd_db", "Its standard deviation, delivered level included; empty where there is a bound", "dB"),
    Meaning("curve", "Threshold curve that 0 dB SL stands for"),
    Meaning("flags", "What a reader has to know of the run, joined by a vertical bar"),
    Meaning("lapse_power", "Probability that this run would have shown a lapse rate of 15 %"),
    Meaning("drift_power", "Probability that this run would have shown a drift of 6 dB"),
    Meaning("notch_trials", "Of a whole curve: trials here that would exclude a notch of 15 dB; 0: it is excluded"),
    *_PRESENTATION,
)
"""One row for each threshold of a finished run."""
