"""Measures all rows on all demonstrations, in processes, under several settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from caesura_lab.evaluation.thesis.reference_segments import ROWS, ThesisRow
from caesura_lab.evaluation.thesis.simulated_demonstrations import SuiteDemonstration
from caesura_lab.evaluation.thesis.table_row_comparison import RowOutcome, condition_demonstration, measure
from caesura_lab.teacher.motion_profiles import Profile
from caesura_service.changepoint.channel_model import ChannelModel
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.presets import PRESETS, Preset
from caesura_service.signals import ConditioningParameters

SCENARIOS = tuple(dict.fromkeys(row.scenario for row in ROWS))


@dataclass(frozen=True)
class SuiteSetting:
    """The setting in which the rows are measured: the teacher, and the choices that the thesis leaves open.

    best: the best segmentation decides, not a threshold; mean_segment_s: segments are geometric about it, not
    of any length; window: of the filter [rows of 0.01 s]; length_unit_m: instead of the constant velocity
    model's; integrated: the preset that judges the rows of `integrated`; online: measure the online rows too;
    rows: only these, all where empty.
    """

    name: str
    profile: Profile = "overdamped"
    wander: bool = False
    gripper: bool = False
    timed: bool = True
    best: bool = False
    mean_segment_s: float | None = None
    window: int | None = None
    length_unit_m: float | None = None
    integrated: str = "integrated"
    online: bool = False
    rows: tuple[str, ...] = ()

    def measures(self, row: ThesisRow) -> bool:
        """Return whether this setting measures a row."""
        return (self.online or not row.online) and (not self.rows or row.name in self.rows)

    @property
    def conditioning(self) -> ConditioningParameters:
        """The parameters of conditioning, with the filter window of this setting."""
        standard = ConditioningParameters()
        return standard if self.window is None else replace(standard, savgol_window=self.window)

    def judged(self, row: ThesisRow) -> ThesisRow:
        """Return the row with the preset that this setting judges it by."""
        return replace(row, preset=self.integrated) if row.preset == "integrated" else row

    def preset(self, name: str) -> Preset:
        """Return a preset by its name, with the changes of this setting."""
        preset = PRESETS[name]
        if self.mean_segment_s is not None:
            preset = replace(preset, mean_segment_s=self.mean_segment_s)
        if self.length_unit_m is not None:
            preset = replace(preset, channels=_RescaledChannels(preset.channels, self.length_unit_m))
        return preset


@dataclass(frozen=True)
class _RescaledChannels:
    """Channels whose constant velocity model uses another length unit [m]."""

    channels: Callable[[float], Mapping[str, ChannelModel]]
    length_unit_m: float

    def __call__(self, bias_n: float) -> Mapping[str, ChannelModel]:
        return {
            name: replace(model, length_unit_m=self.length_unit_m)
            if isinstance(model, ConstantVelocity)
            else model
            for name, model in self.channels(bias_n).items()
        }


MAIN = (
    SuiteSetting("overdamped", online=True),
    SuiteSetting("minimum jerk", profile="minimum_jerk", online=True),
)
_UNITS = ("R1", "R2", "R3")
OPEN = (
    SuiteSetting("best path", best=True, online=True),
    SuiteSetting("mean 2 s", mean_segment_s=2.0),
    SuiteSetting("mean 4 s", mean_segment_s=4.0),
    SuiteSetting("filter 0.31 s", window=31),
    SuiteSetting("sensor as drawn", wander=True),
    SuiteSetting("gripper felt", gripper=True, rows=("R8", "R10", "R11")),
    SuiteSetting("teacher's times", timed=False),
    SuiteSetting(
        "integrated_tab_4_5", integrated="integrated_tab_4_5", online=True, rows=("R10", "R11", "R13")
    ),
    *(SuiteSetting(f"{u * 100:g} cm", length_unit_m=u, rows=_UNITS) for u in (0.02, 0.03, 0.05, 0.1, 1.0)),
)


@dataclass(frozen=True)
class Task:
    """One demonstration, and the settings in which its rows are measured."""

    taught: SuiteDemonstration
    settings: tuple[SuiteSetting, ...]


Result = Mapping[str, Sequence[RowOutcome]]  # by setting


def tasks(seeds: Sequence[int], settings: Sequence[SuiteSetting] = (*MAIN, *OPEN)) -> list[Task]:
    """Return one task for every different demonstration."""
    demonstrations: dict[SuiteDemonstration, list[SuiteSetting]] = {}
    for setting in settings:
        for scenario in SCENARIOS:
            if any(setting.measures(row) for row in ROWS if row.scenario == scenario):
                for seed in seeds:
                    taught = SuiteDemonstration(
                        scenario, seed, setting.profile, setting.wander, setting.gripper, setting.timed
                    )
                    demonstrations.setdefault(taught, []).append(setting)
    return [Task(taught, tuple(some)) for taught, some in demonstrations.items()]


def run_task(task: Task) -> Result:
    """Simulate a demonstration and measure all rows of its scenario."""
    recording, truth = task.taught.load()
    demonstration = {
        s.conditioning: condition_demonstration(recording, truth, s.conditioning) for s in task.settings
    }
    return {
        setting.name: [
            measure(
                setting.judged(row),
                demonstration[setting.conditioning],
                task.taught.seed,
                setting.preset(setting.judged(row).preset),
                best=setting.best,
                any_length=setting.mean_segment_s is None,
            )
            for row in ROWS
            if row.scenario == task.taught.scenario and setting.measures(row)
        ]
        for setting in task.settings
    }
