"""Whole files of formats that several tests alter."""

import copy

TRANSIENT = {"effect_type": "Basis", "position": 0, "keyframes": [
    {"relative_position": 100, "amplitude_modulation": 0.5, "frequency_modulation": 90}]}  # fmt: skip
WAVE = {"effect_type": "Basis", "position": 200, "phase": 0, "base_signal": "Sine", "keyframes": [
    {"amplitude_modulation": 0.5, "frequency_modulation": 90},
    {"relative_position": 250, "frequency_modulation": 400},
    {"relative_position": 500, "amplitude_modulation": 1.0}]}  # fmt: skip
LIMITS = {"lower_frequency_limit": 65, "upper_frequency_limit": 300}
HJIF = {
    "version": "2023", "profile": "Main", "level": 1, "date": "2024-05-06", "description": "", "timescale": 1000,
    "avatars": [], "syncs": [],
    "perceptions": [
        {
            "id": 0, "avatar_id": 0, "description": "", "perception_modality": "Vibrotactile",
            "reference_devices": [{"id": 3, "name": "a", "minimum_frequency": 65, "maximum_frequency": 300}],
            "effect_library": [{**WAVE, "id": 7}],
            "channels": [
                {
                    "id": 0, "description": "", "gain": 0.5, "mixing_coefficient": 1, "body_part_mask": 0,
                    "reference_device_id": 3,
                    "bands": [
                        {"band_type": "Transient", **LIMITS, "effects": [TRANSIENT]},
                        {"band_type": "VectorialWave", **LIMITS, "effects": [
                            WAVE, {"effect_type": "Reference", "id": 7, "position": 1000}]},
                    ],
                }
            ],
        }
    ],
}  # fmt: skip
ACF = """{
  metadata: {version: '2.0.0', device: "Controller", date: '2023-01-19'}, // who
  continuous: {gain: .8, emphasis_ducking: 0.25, frequency_min: 55, frequency_max: +200.},
  /* the emphasis */
  emphasis: {
    gain: 1, fade_out_percent: 50,
    frequency_min: {output_frequency: 55, duration_ms: 36.4, shape: 'sine'},
    'frequency_max': {output_frequency: 165, duration_ms: 12.1, shape: "square",},
  },
}
"""


def changed(document, path, value):
    """A copy of the document with another value at a path; None takes the key away."""
    document = copy.deepcopy(document)
    part = document
    for key in path[:-1]:
        part = part[key]
    if value is None:
        del part[path[-1]]
    else:
        part[path[-1]] = value
    return document
