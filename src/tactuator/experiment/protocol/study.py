"""The part that every protocol file has, whatever is asked: study, circumstances, subjects, and the plan of a visit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from tactuator.errors import BadInput, within
from tactuator.experiment.protocol.codes import doubts
from tactuator.experiment.trial import typed_number, without_controls
from tactuator.experiment.words import COLUMNS, Words, shipped_words
from tactuator.parameters import Flag, NotNegative, Number, Positive, Seconds, Whole, Wording, table
from tactuator.perception.curve import POINTS_MIN

Group = Annotated[
    str,
    StringConstraints(pattern=r"^\w[\w .+/-]{0,63}$"),
    Wording(allowed='1 to 64 letters, digits, spaces, ".", "+", "/", "_" and "-"'),
]
Code = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9]{1,32}$"), Wording(allowed="1 to 32 letters and digits")]
ParticipantId = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z0-9._-]{1,64}$"), Wording(allowed="1 to 64 letters, digits, ., _ and -")
]
_SEED_MAX = 2**53


Celsius = Annotated[NotNegative, Field(le=50.0)]
_Name = Annotated[str, Field(min_length=1, max_length=200)]


@table("[study]")
class StudyPart:
    """Keys of [study]: the experimenter, and the texts for subjects."""

    name: Annotated[_Name, Field(description="name by which the study is known in its store")]
    seed: Annotated[Whole, Field(ge=0, le=_SEED_MAX, description="of every order and trial")]
    experimenter: Annotated[str, Field(description="who runs the sessions")] = ""
    consent: Annotated[str, Field(description="what a subject agrees to; empty: nobody is asked")] = ""
    consent_by: Annotated[Literal["press", "name"], Field(description="a press, or the subject's name as well")] = (
        "press"
    )
    consent_version: Annotated[str, Field(description="version of that text")] = ""
    instructions: Annotated[str, Field(description="what a subject reads before the session")] = ""
    language: Annotated[str, Field(description="of every page")] = "en"
    language_file: Annotated[str | None, Field(description="a language of one's own, beside the protocol")] = None
    visits: Annotated[Whole, Field(ge=1, le=100, description="visits of each subject")] = 1


@table("[session]")
class RunRules:
    """Keys of [session] that every kind of run has: breaks, and the longest interruption of a run."""

    break_after_trials: Annotated[Whole, Field(ge=1, le=100000, description="trials between breaks")] = 100
    break_between_runs: Annotated[Flag, Field(description="a break between runs as well")] = False
    break_s: Annotated[Seconds, Field(description="least duration of a break, by the server's clock")] = 0.0
    resume_within_s: Annotated[Seconds, Field(gt=0.0, description="longest interruption of a run")] = 1800.0


@table("[circumstances]")
class Circumstances:
    """Keys of [circumstances], which psychophysics reports with a threshold; columns of every session."""

    site: Annotated[str, Field(description="place that is stimulated")] = ""
    contact_area_mm2: Annotated[Positive | None, Field(description="area of contact")] = None
    surround: Annotated[str, Field(description="surround of the contactor")] = ""
    skin_temperature_c: Annotated[Celsius | None, Field(description="temperature of the skin")] = None
    preload_n: Annotated[NotNegative | None, Field(description="static force of the finger")] = None
    masking_sound: Annotated[Literal["none", "white", "pink"], Field(description="sound of the page")] = "none"
    masking_level_db_spl: Annotated[Number | None, Field(description="its level, as measured")] = None


_OF_EXPORTS = frozenset(column.name for table in COLUMNS.values() for column in table)


@table("[[demographic]]")
class Demographic:
    """Keys of [[demographic]], a fact that the laboratory notes of every subject."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$", description="column of the exports")]
    label: Annotated[str, Field(min_length=1, max_length=100, description="what the page calls it")]
    kind: Annotated[Literal["number", "choice", "text"], Field(description="what it is")] = "text"
    unit: Annotated[str, Field(description="of a number")] = ""
    low: Annotated[Number | None, Field(description="least number")] = None
    high: Annotated[Number | None, Field(description="largest number")] = None
    choices: Annotated[tuple[str, ...], Field(description="what there is to choose")] = ()
    required: Annotated[Flag, Field(description="no subject is enrolled without it")] = False

    def __post_init__(self) -> None:
        if self.name in _OF_EXPORTS:
            raise BadInput(repr(self.name), "another name than those of the exports' columns", key="name")
        if (self.kind == "choice") != bool(self.choices):
            raise BadInput(f"{self.name}: choices for a {self.kind}", "with a choice, and only there")
        if self.kind != "number" and (self.low is not None or self.high is not None):
            raise BadInput(f"{self.name}: limits for a {self.kind}", "with a number only")

    def take(self, value: str | float) -> str:
        """Return the value as it is stored. Raises BadInput for a value that is not allowed."""
        text = f"{value:.15g}" if isinstance(value, float) else str(value).strip()
        if self.kind == "choice" and text not in self.choices:
            raise BadInput(repr(text), ", ".join(self.choices), key=self.name)
        if self.kind == "text" and len(text) > 200:
            raise BadInput(f"{self.name} has {len(text)} characters", "200 at most")
        if self.kind == "text":
            with within(self.name):
                return without_controls(text)
        if self.kind == "number":
            low, high = (-1e12 if self.low is None else self.low), (1e12 if self.high is None else self.high)
            with within(self.name):
                number = typed_number(text)
            if not low <= number <= high:
                raise BadInput(repr(text), f"a number from {low:g} to {high:g}", key=self.name)
            return f"{number:.15g}"
        return text


@table("[[subject]]")
class SubjectPart:
    """Keys of [[subject]], whose own circumstances win over the study's."""

    code: Annotated[Code, Field(description="code of the subject")]
    group: Annotated[Group, Field(description="group of the subject")] = "unknown"
    participant_id: Annotated[ParticipantId | None, Field(description="the subject's name elsewhere")] = None
    skin_temperature_c: Annotated[Celsius | None, Field(description="of the day")] = None
    demographics: Annotated[dict[str, str | float], Field(description="facts of [[demographic]], by name")] = field(
        default_factory=dict
    )


@table("protocol")
class StudyProtocol:
    """The part of a protocol file that is the same for every kind of study."""

    _: KW_ONLY
    study: StudyPart
    subject: tuple[SubjectPart, ...] = ()
    circumstances: Circumstances = Circumstances()
    demographic: tuple[Demographic, ...] = ()

    def __post_init__(self) -> None:
        each_once("subject codes", [subject.code for subject in self.subject])
        each_once(
            "participant ids",
            [subject.participant_id for subject in self.subject if subject.participant_id is not None],
        )
        each_once("demographic names", [item.name for item in self.demographic])
        for subject in self.subject:
            self.facts(subject.demographics)

    @property
    def asks(self) -> str:
        """Return what is asked: detection, recognition, or the kind of a task."""
        raise NotImplementedError

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """Return the frequencies whose thresholds are measured, where the file lists them."""
        return ()

    @property
    def warning(self) -> str:
        """Return what the study's results will lack, and what other programs make of its codes; "" for nothing."""
        return "; ".join(self.warnings())

    def warnings(self) -> Iterator[str]:
        """Yield each warning."""
        count = len(self.frequencies_hz)
        if 0 < count < POINTS_MIN:
            yield f"no curve: frequencies_hz has {count}; expected {POINTS_MIN} or more"
        codes = [subject.code for subject in self.subject]
        for subject in self.subject:
            yield from doubts(subject.code, codes, shipped_words("en"))
            yield from self.doubtful_facts(subject.demographics, shipped_words("en"))
        others = {name for subject in self.subject for name in (subject.group, subject.participant_id) if name}
        others |= {choice for item in self.demographic for choice in item.choices}
        for name in sorted(others):
            yield from doubts(name, others, shipped_words("en"))

    def doubtful_facts(self, given: Mapping[str, str | float], words: Words) -> Iterator[str]:
        """Yield what other programs make of facts that are texts."""
        for item in self.demographic:
            if item.kind == "text" and given.get(item.name, "") != "":
                yield from doubts(str(given[item.name]).strip(), (), words)

    def faults(self) -> Iterator[BadInput]:
        """Yield every reason why nobody's runs can come to a result, so that nobody is to sit down for them."""
        yield from ()

    @property
    def files(self) -> tuple[str, ...]:
        """Return the files that lie beside the protocol."""
        return () if self.study.language_file is None else (self.study.language_file,)

    def require_observers(self) -> None:
        """Raise BadInput where simulated observers cannot answer."""

    def runs(self, subject: int, visit: int = 1, words: Words | None = None) -> tuple[PlannedRun, ...]:
        """Return the runs of a visit (from 1) of the subject of that number (from 0), alike after any interruption.

        Practice comes first, then every part in the subject's order. words: of titles, English by default.
        """
        language = words or shipped_words("en")
        parts = self.parts(language)
        order = self.order(len(parts), subject, visit)
        practice, first = self.practice(parts, order, language), [parts[index] for index in order]
        if practice and first:
            first[0] = replace(first[0], announcement=language("run.counts"))
        runs = [*practice, *first]
        return tuple(replace(run, position=position) for position, run in enumerate(runs))

    def parts(self, words: Words) -> tuple[PlannedRun, ...]:
        """Return every run that is not practice, once, in the order of the file."""
        raise NotImplementedError

    def order(self, count: int, subject: int, visit: int) -> Sequence[int]:
        """Return the indices of so many parts in the order of the subject's visit: by default as in the file."""
        return range(count)

    def practice(self, parts: Sequence[PlannedRun], order: Sequence[int], words: Words) -> Sequence[PlannedRun]:
        """Return the practice that precedes these parts: by default none."""
        return ()

    def run_seed(self, subject: int, position: int, attempt: int = 0, visit: int = 1) -> tuple[int, ...]:
        """Return the seed of a run; a restarted run gets another."""
        return (self.study.seed, 5, subject, position, attempt, *further(visit))

    def facts(self, given: dict[str, str | float]) -> dict[str, tuple[str, str]]:
        """Return (value, unit) of each demographic item that is given, by name.

        Raises BadInput for an item that is not asked for, or a value that is not allowed.
        """
        values = {name: self.fact(name, value) for name, value in given.items()}
        return {name: (value, unit) for name, (value, unit) in values.items() if value is not None}

    def require_facts(self, part: SubjectPart) -> None:
        """Raise BadInput where a demographic item that the study requires is not given of a subject."""
        for item in self.demographic:
            if item.required and not str(part.demographics.get(item.name, "")).strip():
                self.fact(item.name, "")

    def missing_facts(self) -> Iterator[BadInput]:
        """Yield the refusal of each subject of the protocol who cannot be enrolled."""
        for subject in self.subject:
            try:
                self.require_facts(subject)
            except BadInput as error:
                yield error.within(f"subject {subject.code}")

    def fact(self, name: str, value: str | float) -> tuple[str | None, str]:
        """Return value and unit of a demographic item as they are stored, None for "".

        Raises BadInput for an item that is not asked for, a value that is not allowed, or "" where one is required.
        """
        asked = {item.name: item for item in self.demographic}
        if name not in asked:
            raise BadInput(f"demographics: {name!r}", ", ".join(asked) or "none: the study asks for none")
        value = value.strip() if isinstance(value, str) else value
        if value == "" and asked[name].required:
            raise BadInput(f"demographics: {name} is not given", "with it, since the study requires it")
        return None if value == "" else asked[name].take(value), asked[name].unit

    def apart_from_subjects(self) -> StudyProtocol:
        """Return the protocol without subjects, which an amendment that only enrols leaves as it was."""
        return replace(self, subject=())


def each_once(what: str, values: Sequence[str]) -> None:
    """Raise BadInput if a value occurs twice."""
    if len(set(values)) != len(values):
        raise BadInput(f"{what} {', '.join(values)}", "each once")


FORCED_CHOICE = "forced-choice"
"""Paradigm of detection runs, as the store has it."""
ALL_FINGERS = "all"
"""Finger of a run whose stimuli go to every channel."""


@dataclass(frozen=True)
class PlannedRun:
    """A run as in its row of the store, and as people see it.

    frequency_hz: None where the procedure chooses, or without one. feedback: True if the right response is shown
    after each answer. title: name for the operator. typical_trials: about how many it has. trials: their number, where
    that is known before. practice: True for a run that is not analysed. introduction: text that the subject reads
    before the run begins; an empty one lets it begin at once. announcement: what a page says before it.
    part: the plan of its task that it is of. position:
    counted from 0 in the session.
    """

    finger: str
    frequency_hz: float | None
    paradigm: str
    procedure: str
    feedback: bool
    title: str
    typical_trials: float
    trials: int | None = None
    practice: bool = False
    introduction: str = ""
    announcement: str = ""
    part: int = 0
    position: int = 0

    def practised(self, trials: int, introduction: str, words: Words) -> PlannedRun:
        """Return so many trials of the run as practice."""
        title = words("run.practice", title=self.title)
        return replace(
            self, practice=True, procedure="fixed", title=title, introduction=introduction, typical_trials=trials
        )


def further(visit: int) -> tuple[int, ...]:
    """Return what a visit adds to a seed; the first visit adds nothing, so that its seeds stay as they were."""
    return () if visit == 1 else (visit,)
