"""The suites to judge on: cases that any process can load, by name of a suite or from files."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol
from zlib import crc32

import numpy as np

from caesura_lab.evaluation.cases.annotated_declarations import with_annotated_declarations
from caesura_lab.evaluation.cases.contact_tasks import TASKS, ContactTask
from caesura_lab.evaluation.cases.cut_recordings import WINDOWS, in_window
from caesura_lab.evaluation.cases.estimated_wrenches import FRICTIONS, as_estimate
from caesura_lab.evaluation.cases.free_movements import MOVEMENTS, FreeMovements
from caesura_lab.evaluation.cases.rescaled_recordings import TEMPI, in_tempo
from caesura_lab.evaluation.cases.sensor_conditions import CONDITIONS
from caesura_lab.evaluation.cases.shifted_starts import STARTS, with_shifted_start
from caesura_lab.evaluation.cases.stroke_tasks import STROKE_TASKS, StrokeTask
from caesura_lab.ground_truth import (
    SUFFIX,
    RecordingSource,
    Truth,
    TruthError,
    read_annotation,
    read_truth,
    sha256_of,
    truth_file,
    truth_of,
)
from caesura_lab.teacher.motion_profiles import PROFILES, Profile
from caesura_lab.teacher.scenarios import BASIC, SKILLS
from caesura_protocol.formats.mapping_file_read import load_mapping
from caesura_protocol.formats.read import is_bag, is_rosbag, load_recording
from caesura_protocol.plausibility import METRES
from caesura_protocol.recording import Recording

OPEN = Path(__file__).parents[4] / "data" / "real"  # annotations of the repository, without recordings
READABLE = (".npz", ".csv")
BAGS = (".mcap", ".db3")


class Case(Protocol):
    """A recording with its truth, not loaded yet. It can be pickled."""

    @property
    def name(self) -> str:
        """The name of the case in the results."""

    @property
    def tags(self) -> tuple[str, ...]:
        """The kinds of recording that the case belongs to: results are shown by each."""

    @property
    def group(self) -> str:
        """Return the set of the case: results are compared set by set."""

    @property
    def subject(self) -> str:
        """Return what intervals resample as one: cases of one person, or of one recording, have the same."""

    def load(self) -> tuple[Recording, Truth]:
        """Read or simulate the recording and its truth. Raises TruthError or RecordingError."""


class ReadingOptions(NamedTuple):
    """Names and units that files do not state, as arguments of `load_recording`."""

    mapping: Path | None = None
    force_frame: str | None = None
    length_unit: str | None = None
    time_unit: str | None = None
    angle_unit: str | None = None
    force_unit: str | None = None
    up: str | None = None


AS_STATED = ReadingOptions()
WINDOW_SLACK_S = 0.1  # an observation, by which a window may exceed its recording without being cut


@dataclass(frozen=True)
class FileCase:
    """A recording in a file. annotation: file of its truth, None for the one beside the recording."""

    path: Path
    annotation: Path | None = None
    reading: ReadingOptions = AS_STATED

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.path.name

    @property
    def tags(self) -> tuple[str, ...]:
        """Return the set."""
        return (self.group,)

    @property
    def group(self) -> str:
        """Return the file's name up to its trailing number: `kit_panda_0.npz` belongs to `kit_panda`."""
        return re.sub(r"[_-]?\d+$", "", self.path.stem) or self.path.stem

    @property
    def subject(self) -> str:
        """Return the name of the file. The annotation may state which files show one demonstration."""
        return self.name

    def load(self) -> tuple[Recording, Truth]:
        """Read recording and truth; the annotation declares what the recording does not state."""
        truth = read_truth(self.path) if self.annotation is None else read_annotation(self.annotation)
        check_hash(self.path, truth.source)
        recording = load_recording(
            self.path, wrench_source=self._asked_source(truth), **self.reading._asdict()
        )
        recording, truth = within_recording(recording, truth)
        return with_annotated_declarations(recording, truth), replace(truth, name=self.name)

    def _asked_source(self, truth: Truth) -> str | None:
        """Return the wrench source to read a bag with: that of the truth; None for other files.

        Also None where the mapping states the source.
        """
        mapping = self.reading.mapping
        if not is_rosbag(self.path):
            return None
        mapped = mapping is not None and "wrench_source" in load_mapping(mapping).options
        return None if mapped else truth.wrench_source


def within_recording(recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
    """Return the truth within the times of the recording, and the recording with a caution if it was cut.

    Raises TruthError if the two have no time in common.
    """
    first, last = float(recording.t.min()), float(recording.t.max())
    window = f"window is [{truth.window[0]:g}, {truth.window[1]:g}] s"
    lasts = f"the recording lasts from {first:.10g} to {last:.10g} s"
    if truth.window[1] <= first or truth.window[0] >= last:
        raise TruthError(f"{truth.name}: {window}, and {lasts}")
    if first - WINDOW_SLACK_S <= truth.window[0] and truth.window[1] <= last + WINDOW_SLACK_S:
        return recording, truth
    cut = f"the annotation's {window}, and {lasts}: only what both have is judged"
    return replace(recording, cautions=(*recording.cautions, cut)), truth.within(first, last)


def check_hash(path: Path, source: RecordingSource | None) -> None:
    """Check that a file is the recording that was annotated. Raises TruthError with both hashes.

    source: None for an annotation that names no recording.
    """
    if source is None:
        return
    if path.is_dir():
        raise TruthError(f"{path}: a rosbag2 has no SHA-256, the annotation was made for {source.sha256}")
    found = sha256_of(path)
    if found != source.sha256:
        raise TruthError(f"{path}: SHA-256 is {found}, the annotation was made for {source.sha256}")


@dataclass(frozen=True)
class SimulatedDemonstration:
    """A demonstration of the simulated teacher. hand: the guiding hand is in the wrench."""

    scenario: str
    seed: int
    profile: Profile
    robot: str | None = None
    hand: bool = False

    @property
    def name(self) -> str:
        """A name from which the demonstration can be simulated again."""
        robot = "" if self.robot is None else f"-{self.robot}"
        hand = "-hand" if self.hand else ""
        return f"{self.scenario}-{self.seed}-{self.profile}{robot}{hand}"

    @property
    def tags(self) -> tuple[str, ...]:
        """The scenario, and the motion profile of the hand."""
        return (self.scenario, self.profile)

    @property
    def group(self) -> str:
        """Return the scenario."""
        return self.scenario

    @property
    def subject(self) -> str:
        """Return the person, who is the same in every scenario."""
        return f"person {self.seed}"

    def load(self) -> tuple[Recording, Truth]:
        """Simulate the recording and its truth."""
        # Pinocchio takes a second to load: only for who teaches.
        from caesura_lab.teacher.simulated_teaching import teach  # noqa: PLC0415

        demonstration = teach(
            self.scenario,
            seed=self.seed,
            profile=self.profile,
            wrench_source="flange_sensor_with_hand" if self.hand else "flange_sensor",
            natural=True,
            robot=self.robot,
        )
        return demonstration.recording, truth_of(demonstration.truth, self.name)


@dataclass(frozen=True)
class ChangedCase(ABC):
    """A case with one change; condition: its name, by which results are grouped as by robot."""

    case: Case
    condition: str

    @property
    def name(self) -> str:
        """The condition and the recording's name."""
        return f"{self.condition}: {self.case.name}"

    @property
    def tags(self) -> tuple[str, ...]:
        """The condition."""
        return (self.condition,)

    @property
    def group(self) -> str:
        """The condition."""
        return self.condition

    @property
    def subject(self) -> str:
        """Return that of the unchanged case."""
        return self.case.subject

    def load(self) -> tuple[Recording, Truth]:
        """Load the case and change it."""
        recording, truth = self._changed(*self.case.load())
        return recording, replace(truth, name=self.name, robot=self.condition)

    @abstractmethod
    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]: ...

    def _chance(self) -> np.random.Generator:
        """Return random numbers that depend only on the unchanged case's name."""
        return np.random.default_rng(crc32(self.case.name.encode()))


def _in_metres(recording: Recording) -> Recording:
    """Return the recording with its positions in metres."""
    if "pos" not in recording.signals:
        return recording
    positions = METRES[recording.length_unit] * recording.signals["pos"]
    return replace(recording, signals=dict(recording.signals) | {"pos": positions}, length_unit="m")


class PoorerCase(ChangedCase):
    """A case with the sensors of one of CONDITIONS and unchanged truth."""

    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
        return CONDITIONS[self.condition](_in_metres(recording), self._chance()), truth


class EstimateCase(ChangedCase):
    """A case with an estimated wrench, by one of FRICTIONS, and without a hand."""

    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
        estimate = as_estimate(recording, self.condition, self._chance())
        return estimate, replace(truth, hand_in_wrench=False)


class OtherTempoCase(ChangedCase):
    """A case with another duration or path size, by one of TEMPI."""

    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
        return in_tempo(recording, truth, self.condition)


class WindowCase(ChangedCase):
    """A part of a case, by one of WINDOWS."""

    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
        return in_window(recording, truth, self.condition)


class LaterCase(ChangedCase):
    """A case with a later start, by one of STARTS."""

    def _changed(self, recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
        return with_shifted_start(recording, truth, self.condition)


@dataclass(frozen=True)
class SuiteOptions:
    """The size of a suite: people a scenario, the first of them, and the directory of recordings.

    annotations: the directory of annotations whose recordings lie in `data`. robot: of the simulated teacher.
    """

    seeds: int = 5
    first_seed: int = 1
    data: Path = OPEN
    annotations: Path = OPEN
    robot: str | None = None

    @property
    def people(self) -> range:
        """The seeds."""
        return range(self.first_seed, self.first_seed + self.seeds)


def suite(name: str, extent: SuiteOptions) -> list[Case]:
    """Return the cases of a suite. Raises TruthError for an unknown or empty one."""
    if name not in SUITES:
        raise TruthError(f"no suite {name!r}, known: {', '.join(SUITES)}")
    return SUITES[name](extent)


def teacher(extent: SuiteOptions) -> list[Case]:
    """Return every basic scenario by `seeds` persons; a third of the persons use each motion profile.

    Seed 0, the thesis' person, is left out, because it was used during the development of the models.
    """
    return _taught(BASIC, extent)


def skills(extent: SuiteOptions) -> list[Case]:
    """Return every scenario with turns, circles or repeated strokes, by persons as in `teacher`."""
    return _taught(SKILLS, extent)


def hand(extent: SuiteOptions) -> list[Case]:
    """Return wiping and the scenarios of `skills`, with the guiding hand in the wrench: contact is off."""
    return _taught(("wiping", *SKILLS), extent, hand=True)


def movements(extent: SuiteOptions) -> list[Case]:
    """Return `seeds` demonstrations of every kind of free movement, by published laws and without a robot."""
    return [FreeMovements(kind, seed) for kind in MOVEMENTS for seed in extent.people]


def tasks(extent: SuiteOptions) -> list[Case]:
    """Return `seeds` demonstrations of every task in contact, by published laws and without a robot."""
    return [ContactTask(kind, seed) for kind in TASKS for seed in extent.people]


def repetitions(extent: SuiteOptions) -> list[Case]:
    """Return `seeds` demonstrations of every task of many strokes, by published laws, with phases."""
    return [StrokeTask(kind, seed) for kind in STROKE_TASKS for seed in extent.people]


def estimates(extent: SuiteOptions) -> list[Case]:
    """Return the cases of `teacher` with an estimated wrench, once for every friction of the joints."""
    return [EstimateCase(case, friction) for friction in FRICTIONS for case in teacher(extent)]


def _taught(scenarios: Iterable[str], extent: SuiteOptions, *, hand: bool = False) -> list[Case]:
    return [
        SimulatedDemonstration(scenario, seed, PROFILES[(i + seed) % len(PROFILES)], extent.robot, hand)
        for i, scenario in enumerate(scenarios)
        for seed in extent.people
    ]


def files(paths: Sequence[Path], reading: ReadingOptions = AS_STATED) -> list[Case]:
    """Return recordings by name, each once; a directory that is no rosbag2 adds all annotated ones in it."""
    named = [file for path in paths for file in (directory(path) if _holds_recordings(path) else [path])]
    once = {os.path.abspath(file): file for file in named}
    return [FileCase(file, reading=reading) for file in once.values()]


def directory(path: Path) -> list[Path]:
    """Return every annotated recording of a directory. Raises TruthError if there is none."""
    if not (found := _annotated(path)):
        raise TruthError(f"{path}: no annotated recording, expected x.npz or x.csv with x{SUFFIX} beside it")
    return found


def _holds_recordings(path: Path) -> bool:
    return path.is_dir() and not is_bag(path)


def real(extent: SuiteOptions) -> list[Case]:
    """Return the openly annotated recordings in the directory, and those with an annotation beside them.

    Raises TruthError where there is neither, or where an annotation does not name its recording.
    """
    named = open_annotations(extent.annotations)
    beside = [path for path in _annotated(extent.data) if path.name not in named]
    present = [FileCase(extent.data / name, file) for name, (file, _) in named.items()]
    cases: list[Case] = [case for case in present if case.path.is_file()]
    cases += [FileCase(path) for path in beside]
    if not cases:
        missing = f"; of the recordings of {extent.annotations} {len(named)} are missing" if named else ""
        raise TruthError(
            f"{extent.data}: no annotated recording, expected x.npz or x.csv with x{SUFFIX} beside it"
            f"{missing}"
        )
    return cases


def _under_each(
    case_of: Callable[[Case, str], Case], conditions: Iterable[str], extent: SuiteOptions
) -> list[Case]:
    """Return the recordings of `real` under every condition. Raises TruthError as `real`."""
    cases = real(extent)
    return [case_of(case, condition) for condition in conditions for case in cases]


def missing_recordings(name: str | None, extent: SuiteOptions) -> list[str]:
    """Return a note on every openly annotated recording that is missing, so that a suite leaves it out.

    name: of the suite, None where files are judged.
    """
    if name not in SUITES or name in SIMULATED:
        return []
    return [
        f"{file}: not in {extent.data}, left out; its source: {source.source or 'not stated'}"
        for file, (_, source) in open_annotations(extent.annotations).items()
        if not (extent.data / file).is_file()
    ]


def open_annotations(path: Path = OPEN) -> dict[str, tuple[Path, RecordingSource]]:
    """Return the annotation file of every recording that a directory of annotations names.

    Of several annotations of one recording the one with the recording's own name counts, else the first.
    Raises TruthError for an annotation that does not name its recording.
    """
    found: dict[str, tuple[Path, RecordingSource]] = {}
    for file in sorted(path.glob(f"*{SUFFIX}")):
        source = read_annotation(file).source
        if source is None:
            raise TruthError(f"{file}: 'recording' is missing, expected file and sha256 of what it annotates")
        if source.file not in found or file.name == truth_file(Path(source.file)).name:
            found[source.file] = file, source
    return found


def _annotated(path: Path) -> list[Path]:
    """Return the recordings of a directory that have an annotation beside them. Raises TruthError."""
    if not path.is_dir():
        raise TruthError(f"{path}: no such directory; name the recordings' with --data")
    stems = [file.name.removesuffix(SUFFIX) for file in sorted(path.glob(f"*{SUFFIX}"))]
    return [recording for stem in stems for recording in _recordings(path / stem)]


def _recordings(annotated: Path) -> list[Path]:
    """Return the files of a recording; those of a bag only where no other is beside its annotation."""
    files_of = [annotated.with_name(f"{annotated.name}{suffix}") for suffix in (*READABLE, *BAGS)]
    present = [file for file in files_of if file.is_file()]
    plain = [file for file in present if file.suffix in READABLE]
    return plain or present or ([annotated] if is_bag(annotated) else [])


TAUGHT = ("teacher", "skills", "hand", "estimates")  # suites in which a robot is simulated
SIMULATED = (*TAUGHT, "movements", "tasks", "repetitions")  # suites that need no recordings
SUITES: Mapping[str, Callable[[SuiteOptions], list[Case]]] = {
    "teacher": teacher,
    "skills": skills,
    "hand": hand,
    "estimates": estimates,
    "movements": movements,
    "tasks": tasks,
    "repetitions": repetitions,
    "real": real,
    "sensors": partial(_under_each, PoorerCase, CONDITIONS),
    "tempo": partial(_under_each, OtherTempoCase, TEMPI),
    "windows": partial(_under_each, WindowCase, WINDOWS),
    "starts": partial(_under_each, LaterCase, STARTS),
}
