"""A recording: the data that one robot reported during one demonstration.

Npz, csv and MCAP files, messages and live sources use the same names, so that a recording and a live robot
have the same form. A signal is a matrix with one row per sample:

    pos (n, 3)   flange position in the base frame, in `length_unit`
    quat (n, 4)  flange orientation in the base frame, x y z w
    q (n, j)     positions of the j joints [rad], at most 8
    force (n, 3) force of the environment on the robot [N], in `force_frame`
    torque (n, 3) its moment [Nm]
    tau (n, j)   external joint torques [Nm]
    gripper (n, 1) opening between the fingers [m]

At least one of `pos` and `q` is required; with both, `pos` is segmented. Other content of a file is not read,
and is listed in `Recording.ignored`, so that a typo in an option is detected.

A recording states where its wrench is measured (`wrench_source`) and whether a person guides this robot by
hand (`hand_on_robot`). A source that is not stated is None: the service then assumes that the force contains
the guiding hand, and the results state that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_protocol.columns import JOINT_SIGNALS
from caesura_protocol.description_texts import DESCRIBED, description_texts
from caesura_protocol.errors import CaesuraError
from caesura_protocol.lost_samples import Loss, losses_in_words, losses_text
from caesura_protocol.messages import (
    COLUMNS_OF_SIGNAL,
    FORCE_FRAMES,
    HANDS_ON_ROBOT,
    LENGTH_UNITS,
    WRENCH_SOURCES,
    Assumption,
    Description,
    ForceFrame,
    HandOnRobot,
    LengthUnit,
    Quantity,
    Vector,
    WrenchSource,
)
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import UNITS, WIRE_UNIT, Implausible, doubts, implausible
from caesura_protocol.programs.safety import UNSET, CellSettings
from caesura_protocol.validation_words import not_one_of

Array = NDArray[np.float64]


class RecordingError(CaesuraError, ValueError):
    """The file is not a recording; the message states the file, the value and the expected content."""


class UnknownColumnsError(RecordingError):
    """The columns are those of other software; `example` is a mapping file that names them."""

    def __init__(self, message: str, example: str) -> None:
        super().__init__(message)
        self.example = example


@dataclass(frozen=True)
class Recording:
    """One demonstration.

    t: (n,) [s], in the order of arrival; signals: name → (n, width), names as in the module's table. Lists
    become arrays.
    wrench_source: None if not stated; hand_on_robot: whether a person guides this robot by hand. ignored:
    names of other content of the file. declared_units: quantities whose unit a user declared: their
    implausible values are accepted, and `doubts` reports them. setting: the cell's requirements on the
    program. assumed: the reader's assumptions about what the file leaves open; cautions: omitted or suspect
    parts, with the reason; one sentence each. lines: line numbers of the samples in a text file. lost: the
    times [s] beside samples that were lost on the way. description: operators' statements about it. changes:
    how often people changed its results, which its samples do not show. Raises RecordingError for an invalid
    shape, name, unit or time.
    """

    t: Array
    signals: Mapping[str, Array]
    wrench_source: WrenchSource | None = None
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    name: str = field(default="recording", compare=False)
    ignored: tuple[str, ...] = field(default=(), compare=False)
    hand_on_robot: HandOnRobot = "unknown"
    declared_units: tuple[Quantity, ...] = field(default=(), compare=False)
    setting: CellSettings = UNSET
    assumed: tuple[str, ...] = field(default=(), compare=False)
    cautions: tuple[str, ...] = field(default=(), compare=False)
    lines: tuple[int, ...] = field(default=(), compare=False, repr=False)
    lost: tuple[Loss, ...] = ()
    description: Description = field(default_factory=Description)
    changes: int = 0  # corrections and edits of the program; undo and redo count
    began_s: float | None = field(default=None, compare=False)  # [s] time of day at time 0; None: not known

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", self._numbers("t", self.t))
        signals = {signal: self._numbers(signal, values) for signal, values in self.signals.items()}
        object.__setattr__(self, "signals", MappingProxyType(signals))
        self._check_times()
        if not {"pos", "q"} & set(self.signals):
            raise RecordingError(
                f"{self.name}: has {', '.join(sorted(self.signals)) or 'no signals'}, "
                "expected at least one of pos and q"
            )
        for signal, values in self.signals.items():
            self._check_signal(signal, values)
        self._check_options()

    def _check_times(self) -> None:
        if self.t.ndim != 1 or self.t.size == 0:
            remedy = (
                ": write t.ravel()" if self.t.size and max(self.t.shape, default=0) == self.t.size else ""
            )
            raise RecordingError(
                f"{self.name}: t has shape {self.t.shape}, expected (n,) with n >= 1{remedy}"
            )
        if not np.isfinite(self.t).all():
            first = int(np.flatnonzero(~np.isfinite(self.t))[0])
            raise RecordingError(
                f"{self.name}: {self.place(first)}: t is {self.t[first]}, expected a finite number: "
                f"{LEAVE_OUT}"
            )

    def _check_signal(self, signal: str, values: Array) -> None:
        if signal not in COLUMNS_OF_SIGNAL:
            raise RecordingError(
                f"{self.name}: unknown signal {signal!r}, known: {', '.join(COLUMNS_OF_SIGNAL)}"
            )
        width = len(COLUMNS_OF_SIGNAL[signal])
        widths = range(1, width + 1) if signal in JOINT_SIGNALS else (width,)
        if values.ndim != 2 or len(values) != self.t.size or values.shape[1] not in widths:
            expected = f"({self.t.size}, {'1 to ' * (len(widths) > 1)}{width})"
            raise RecordingError(
                f"{self.name}: {signal} has shape {values.shape}, expected {expected}"
                f"{_shape_remedy(signal, values.shape, self.t.size)}"
            )
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            name = COLUMNS_OF_SIGNAL[signal][column]
            raise RecordingError(
                f"{self.name}: {self.place(int(row))}: {name} is {values[row, column]}, expected a "
                f"finite number: {LEAVE_OUT}"
            )

    def _numbers(self, name: str, values: ArrayLike) -> Array:
        """Return values as an array of floats; masked ones become nan. Raises RecordingError."""
        try:
            found: np.ma.MaskedArray[Any, np.dtype[Any]] = np.ma.asarray(values)
        except (TypeError, ValueError) as error:  # such as rows of different lengths
            raise RecordingError(f"{self.name}: {name} is no array of numbers: {error}") from error
        if found.dtype.kind not in "biuf":
            raise RecordingError(
                f"{self.name}: {name} has elements of type {found.dtype}, expected an array of numbers"
            )
        return np.asarray(np.ma.filled(found.astype(np.float64, copy=False), np.nan))

    def _check_options(self) -> None:
        for key, known in OPTIONS.items():
            if not is_option(key, getattr(self, key)):
                raise RecordingError(f"{self.name}: {not_one_of(key, getattr(self, key), known)}")
        if (wrong := contradiction(self.wrench_source, self.hand_on_robot)) is not None:
            raise RecordingError(f"{self.name}: {wrong}")

    def place(self, row: int) -> str:
        """Return the name of a sample in errors, with its line in a text file.

        >>> Recording(np.zeros(2), {"q": np.zeros((2, 7))}, lines=(2, 5)).place(1)
        'sample 1 (line 5)'
        """
        return f"sample {row} (line {self.lines[row]})" if row < len(self.lines) else f"sample {row}"

    @property
    def up(self) -> Vector | None:
        """The direction away from gravity in the base frame, of length 1; None: not stated, z is assumed."""
        return self.setting.up

    @property
    def has_wrench(self) -> bool:
        """Whether the recording has forces or joint torques."""
        return "force" in self.signals or "tau" in self.signals

    @property
    def implausible(self) -> Implausible | None:
        """The first quantity that is probably in another unit than the recording states, or None."""
        return implausible(
            self.t,
            self.signals,
            length_unit=self.length_unit,
            declared=self.declared_units,
            robot=self.setting.robot,
        )

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on contradictions to the stated units; the samples are used nevertheless."""
        return doubts(
            self.t,
            self.signals,
            length_unit=self.length_unit,
            declared=self.declared_units,
            clean_force=self.wrench_source == "flange_sensor",
            robot=self.setting.robot,
        )

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Options that the recording leaves open and the reader assumes; `assumed` has their text."""
        return tuple(key for key, words in ASSUMED.items() if words in self.assumed)

    @property
    def stated_options(self) -> dict[str, str]:
        """Return the options by name, losses and changes, without those that the recording does not state."""
        values = {key: getattr(self, key) for key in OPTIONS if key not in self.assumptions}
        lost = {LOST: losses_text(self.lost)} if self.lost else {}
        changes = {CHANGES: str(self.changes)} if self.changes else {}
        stated = {key: value for key, value in values.items() if value not in NOT_STATED}
        return stated | self.setting.stated_texts | lost | changes

    @property
    def beyond_samples(self) -> tuple[str, ...]:
        """Sentences on what the samples do not show: losses, and changes that people made to the results."""
        lost = (losses_in_words(self.lost),) if self.lost else ()
        return (*lost, CHANGED.format(counted(self.changes, "time"))) if self.changes else lost

    @property
    def file_statements(self) -> dict[str, str]:
        """Return what a file states: options, description, and the order of quaternions where it is assumed.

        An npz leaves that order out instead: without it the reader assumes it again.
        """
        order = {ASSUMED_IN_FILE: "quaternion_order"} if "quaternion_order" in self.assumptions else {}
        return self.stated_options | self.session_texts | order

    @property
    def session_texts(self) -> dict[str, str]:
        """Return what is known of the session beside its samples: description and time of day."""
        began = {} if self.began_s is None else {BEGAN: repr(self.began_s)}
        return description_texts(self.description) | began

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of `matrix`, as in messages."""
        return ("t", *(c for s, v in self.signals.items() for c in COLUMNS_OF_SIGNAL[s][: v.shape[1]]))

    def matrix(self) -> Array:
        """Return all samples as one (n, columns) matrix, time first."""
        return np.column_stack([self.t, *self.signals.values()])

    def save(self, path: Path) -> None:
        """Write the recording as npz."""
        arrays = {s: v[:, 0] if v.shape[1] == 1 else v for s, v in self.signals.items()}
        stated = self.stated_options | self.session_texts
        options = {key: np.array(value) for key, value in stated.items()}
        if "quat" in arrays and "quaternion_order" not in self.assumptions:
            options[QUATERNION_ORDER] = np.array("xyzw")
        np.savez_compressed(path, t=self.t, **arrays, **options)  # type: ignore[arg-type]


LEAVE_OUT = "leave out the samples that have none, or the whole signal"


def _shape_remedy(signal: str, shape: tuple[int, ...], samples: int) -> str:
    """Return the remedy for an array of a wrong shape; empty if the shape does not show one.

    >>> _shape_remedy("force", (3, 500), 500), _shape_remedy("pos", (500, 2), 500)
    (': it is transposed, write force.T', '')
    """
    if signal == "quat" and shape[1:] in {(3, 3), (3,)}:
        made = "from_matrix" if len(shape) == 3 else "from_euler or from_rotvec"
        return f": quaternions have four columns, x y z w (scipy's Rotation.{made}(…).as_quat())"
    if len(shape) != 2:
        return ""
    width = len(COLUMNS_OF_SIGNAL[signal])
    turned = shape[1] == samples != shape[0]
    columns = shape[0] if turned else shape[1]
    if signal == "force" and columns == 6 and samples in shape:
        wrench = "wrench.T" if turned else "wrench"
        return f": a wrench is two arrays, force = {wrench}[:, :3] and torque = {wrench}[:, 3:]"
    if turned and (columns == width or signal in JOINT_SIGNALS):
        return f": it is transposed, write {signal}.T"
    if signal == "pos" and columns == 7 and samples in shape:
        pose = "pose.T" if turned else "pose"
        return f": a pose is two arrays, pos = {pose}[:, :3] and quat = {pose}[:, 3:] in the order x y z w"
    return "" if samples in shape else f": one row for each of the {samples} times in t"


OPTIONS: Mapping[str, tuple[str, ...]] = {
    "wrench_source": WRENCH_SOURCES,
    "hand_on_robot": HANDS_ON_ROBOT,
    "force_frame": FORCE_FRAMES,
    "length_unit": LENGTH_UNITS,
}
LOST = "lost"  # key of the losses in a file
BEGAN = "began_s"  # key of the time of day in a file
CHANGES = "changes_by_people"  # key of their number in a file
CHANGED = (
    "People changed the results of this session {}, by corrections or edits of the program: "
    "what is inferred from its samples has none of these changes."
)
STATED = (
    *OPTIONS,
    *CellSettings._fields,
    LOST,
    CHANGES,
    BEGAN,
)  # all that a file may state about its samples
OF_FILE = (*STATED, *DESCRIBED)  # all that a file may state
#: How the columns of `quat` are ordered in an npz file, whose arrays have no names of columns.
QUATERNION_ORDER, QUATERNION_ORDERS = "quaternion_order", ("xyzw", "wxyz")
ASSUMED_ORDER = (
    "Quaternion order x, y, z, w: assumed. State quaternion_order in the file: xyzw, or wxyz, "
    "which is reordered."
)
ASSUMED_FRAME = (
    "Frame of the force: base, assumed. State whether it is base or flange; flange needs an orientation."
)
ASSUMED_FLAG = "Gripper: a flag of which 1 is closed and 0 open, assumed. Exchange them where 1 is open."
ASSUMED: Mapping[Assumption, str] = {"quaternion_order": ASSUMED_ORDER, "force_frame": ASSUMED_FRAME}
ASSUMED_IN_FILE = "assumed"  # key of a csv's comment or an MCAP's metadata: what its writer assumed
NOT_STATED = (None, "unknown")  # values of an option that no file needs to hold


def assumed_by_writer(stated: Mapping[str, str]) -> tuple[str, ...]:
    """Return texts on what the writer of a file assumed. stated: its comments or metadata, by their keys."""
    return (ASSUMED_ORDER,) if stated.get(ASSUMED_IN_FILE) == "quaternion_order" else ()


def is_option(key: str, value: str | None) -> bool:
    """Return whether a value is valid for this option; a wrench_source of None is not stated."""
    return value in OPTIONS[key] or (key, value) == ("wrench_source", None)


def contradiction(wrench_source: str | None, hand_on_robot: str) -> str | None:
    """Return text if the wrench source contradicts the statement of the hand, else None."""
    if (wrench_source, hand_on_robot) != ("flange_sensor_with_hand", "no"):
        return None
    return (
        "hand_on_robot is 'no', which contradicts wrench_source 'flange_sensor_with_hand': expected "
        "hand_on_robot 'yes' or 'unknown', or wrench_source 'flange_sensor' or 'joint_torque_estimate'"
    )


ARRAYS = ("t", *COLUMNS_OF_SIGNAL, "force_base")  # names of the arrays of a file


def wrong_option(name: str, value: str, known: Iterable[str]) -> str:
    """Return the error text for an invalid value of a command line option."""
    return not_one_of(f"--{name.replace('_', '-')}", value, known)


def declared_units(**units: str | None) -> dict[Quantity, str]:
    """Return the declared units, by quantity. Raises RecordingError for an unknown unit."""
    declared: dict[Quantity, str] = {}
    for quantity, known in UNITS.items():
        if (unit := units.get(quantity)) is None:
            continue
        if unit not in known:
            raise RecordingError(wrong_option(f"{quantity}_unit", unit, known))
        declared[quantity] = unit
    return declared


def unit_remedy(found: Implausible, length_unit: str) -> str:
    """Return the option by which a user confirms the stated unit, or states the likely one."""
    option = f"--{found.quantity}-unit"
    stated = length_unit if found.quantity == "length" else WIRE_UNIT[found.quantity]
    believed = f"{option} {stated} if the values are right"
    return f"State {believed}" if found.likely is None else f"State {option} {found.likely}, or {believed}"


def did_you_mean(name: str) -> str | None:
    """Return the valid name that an ignored one resembles; None without one.

    >>> did_you_mean("length_units"), did_you_mean("vel")
    ('length_unit', None)
    """
    columns = (column for names in COLUMNS_OF_SIGNAL.values() for column in names if len(column) > 2)
    close = get_close_matches(name.lower(), [*ARRAYS, *STATED, *columns], n=1, cutoff=0.8)
    return close[0] if close and close[0] != name else None
