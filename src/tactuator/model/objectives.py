"""Objectives that a verdict judges: the paper's four (its section 2), and what a controller needs to run on a board.

An objective begins as a line here. Its findings are made by whoever judges it: `synthesis/verdict.py` from the model,
`measure/` from a measurement, `wordlength/assessment.py` from a build. Tolerances stand in `requirements.py`.
"""

OBJECTIVES = {
    "i": "|H| follows the threshold curve over the band, without load",
    "ii": "every mains line is felt below threshold",
    "iii": "noise is felt below threshold in every third octave, and no resonance stands out",
    "iv": "a finger's load does not change |H| at low frequencies",
    "build": "a board takes the controller as an image",
}
"""What each objective asks for, in words, by its number; verdicts name them in this order."""

OF_THE_LOOP = ("i", "ii", "iii", "iv")
"""Objectives that a closed loop has to be stable for."""
