"""What is judged on: cases that can be loaded anywhere, by name of a suite or from files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from caesura_clients.bridge.teacher.intentions import PROFILES, Profile
from caesura_clients.bridge.teacher.scenarios import SCENARIOS
from caesura_clients.recording import Recording, load_recording
from caesura_service.truth import SUFFIX, Truth, TruthError, read_truth, truth_of

REAL = Path(__file__).parents[4] / "shared" / "data" / "real"
READABLE = (".npz", ".csv")


class Case(Protocol):
    """A recording with its truth, not loaded yet. It can be pickled."""

    @property
    def name(self) -> str:
        """As it stands in the results."""

    @property
    def tags(self) -> tuple[str, ...]:
        """What kind of recording it is: results are shown by each."""

    def load(self) -> tuple[Recording, Truth]:
        """Read or simulate it. Raises TruthError or RecordingError."""


@dataclass(frozen=True)
class FileCase:
    """A recording in a file, with its annotation beside it."""

    path: Path

    @property
    def name(self) -> str:
        """The file's."""
        return self.path.name

    @property
    def tags(self) -> tuple[str, ...]:
        """None: a file says nothing of where it comes from."""
        return ()

    def load(self) -> tuple[Recording, Truth]:
        """Where the annotation says that the hand is in the wrench, the wrench is read so."""
        truth = read_truth(self.path)
        recording = load_recording(self.path)
        first, last = float(recording.t.min()), float(recording.t.max())
        if truth.window[1] <= first or truth.window[0] >= last:
            window = f"window is [{truth.window[0]:g}, {truth.window[1]:g}] s"
            raise TruthError(
                f"{truth.name}: {window}, and the recording lasts from {first:.10g} to {last:.10g} s"
            )
        if truth.hand_in_wrench and recording.wrench_source == "flange_sensor":
            recording = replace(recording, wrench_source="flange_sensor_with_hand")
        return recording, replace(truth, name=self.name)


@dataclass(frozen=True)
class TaughtCase:
    """A demonstration of the simulated teacher."""

    scenario: str
    seed: int
    profile: Profile

    @property
    def name(self) -> str:
        """Enough to simulate it again."""
        return f"{self.scenario}-{self.seed}-{self.profile}"

    @property
    def tags(self) -> tuple[str, ...]:
        """What is taught, and how the hand moves."""
        return (self.scenario, self.profile)

    def load(self) -> tuple[Recording, Truth]:
        """Simulate it."""
        # Pinocchio takes a second to load: only for who teaches.
        from caesura_clients.bridge.teacher.teaching import teach  # noqa: PLC0415

        demonstration = teach(self.scenario, seed=self.seed, profile=self.profile, natural=True)
        return demonstration.recording, truth_of(demonstration.truth, self.name)


@dataclass(frozen=True)
class Extent:
    """How much of a suite is wanted: people a scenario, the first of them, and where recordings lie."""

    seeds: int = 5
    first_seed: int = 1
    data: Path = REAL


def suite(name: str, extent: Extent) -> list[Case]:
    """The cases of a suite. Raises TruthError for one that does not exist or is empty."""
    if name not in SUITES:
        raise TruthError(f"no suite {name!r}, known: {list(SUITES)}")
    return SUITES[name](extent)


def teacher(extent: Extent) -> list[Case]:
    """Every scenario by `seeds` people; a third of them each moves by each profile.

    Seed 0, the thesis' own person, is left out: it was looked at while the models were made.
    """
    people = range(extent.first_seed, extent.first_seed + extent.seeds)
    return [
        TaughtCase(scenario, seed, PROFILES[(i + seed) % len(PROFILES)])
        for i, scenario in enumerate(SCENARIOS)
        for seed in people
    ]


def files(paths: Sequence[Path]) -> list[Case]:
    """Recordings by name; a directory stands for all annotated ones in it."""
    cases: list[Case] = []
    for path in paths:
        cases += directory(path) if path.is_dir() else [FileCase(path)]
    return cases


def directory(path: Path) -> list[Case]:
    """Every annotated recording of a directory. Raises TruthError where there is none."""
    if not path.is_dir():
        raise TruthError(f"{path}: no such directory; name the recordings' with --data")
    stems = [file.name.removesuffix(SUFFIX) for file in sorted(path.glob(f"*{SUFFIX}"))]
    found = [path / f"{stem}{suffix}" for stem in stems for suffix in READABLE]
    cases: list[Case] = [FileCase(file) for file in found if file.is_file()]
    if not cases:
        raise TruthError(f"{path}: no annotated recording, expected x.npz with x{SUFFIX} beside it")
    return cases


SUITES: Mapping[str, Callable[[Extent], list[Case]]] = {
    "teacher": teacher,
    "real": lambda extent: directory(extent.data),
}
