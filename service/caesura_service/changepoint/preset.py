"""A preset: the kinds of segment, the channel models of each, and the decision parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from caesura_service.changepoint.channel_model import ChannelModel, Choice
from caesura_service.changepoint.filter_choice import make_filter
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Geometric, Hazard, Refractory
from caesura_service.changepoint.segment_model_set import ContactState, SegmentKind, SegmentModelSet
from caesura_service.changepoint.turn_in_place import TurnInPlace
from caesura_service.changepoint.turn_resistance import TurnResistance

SEGMENTATION_HZ = 10.0
STEP_S = 1.0 / SEGMENTATION_HZ
SENSOR_BIAS_N = 1.5  # scale of what free space reads, where nothing else is known of the wrench
BESIDE_MOVEMENT = 0.01  # a tool that sticks and slips along a line mostly stands before and after it

# What is left where the force does not show contact: the kinds, and the channels that look at the position.
MOVEMENT = (
    SegmentKind("motion", "motion", "free", ("moving", "corner")),
    SegmentKind("motion", "motion", "free", ("traced",), beside_movement=BESIDE_MOVEMENT),
    SegmentKind("steady", "steady", "free", ("still", "unturned")),
    SegmentKind("turning", "motion", "free", ("turning", "turned_back", "about_a_point")),
)


@dataclass(frozen=True)
class Preset:
    """A named choice of channel models, kinds and parameters by which a demonstration is segmented.

    channels: the channel models, given the scale of the force's bias [N]; kinds: of the whole lattice.
    `mean_segment_s` [s] sets the hazard, which is low for the first `refractory_s` [s] of a segment. After
    its first observation it is `single_share` of what it is later. Segments shorter than `least_segment_s`
    [s] become no app (the thesis' minimum time filter).

    `continuous`: a segment begins where the one before it ends, at its last sample, and the changepoint lies
    midway between that and its own first; otherwise it begins with its own first sample, as in the thesis.
    `threshold` on the smoothed probability decides what is a changepoint, as in the thesis; without one the
    best segmentation does.

    `unrepeated` lists groups of kinds of which no two segments follow each other. `power` of the joint
    probability calibrates the stated probabilities. It does not change the best segmentation, but which
    changepoints are taken for certain.

    `turn_share` makes a movement a turning if the rotation explains its path: the centre may move by this
    share of the squared path of a point at a hand's breadth from the axis. With 0 the kinds' evidence
    decides.
    """

    name: str
    channels: Callable[[float], Mapping[str, ChannelModel]]
    kinds: tuple[SegmentKind, ...]
    maximum: bool = False
    continuous: bool = False
    mean_segment_s: float = 2.0
    refractory_s: float = 0.0
    single_share: float | None = None
    least_segment_s: float = 0.3
    threshold: float | None = None
    unrepeated: tuple[tuple[str, ...], ...] = ()
    power: float = 1.0
    turn_share: float = 0.0
    filter: FilterParameters = field(default_factory=FilterParameters)

    def lattice(
        self,
        *,
        contact: bool = True,
        transport: bool = True,
        orientation: bool = False,
        torque: bool = False,
        bias_n: float = SENSOR_BIAS_N,
    ) -> SegmentModelSet:
        """Return the model set for the signals that a session reports.

        Without `contact` the force is not used, and the kinds distinguish only whether the arm moves. Without
        an orientation no channel uses the rotation, and there are no turns. Without a torque no channel uses
        it, and kinds that differ only by it are united. bias_n [N]: scale of the force in free space. Raises
        ValueError if no signal is left.
        """
        channels = self.channels(bias_n)
        if not orientation:
            channels = {name: model for name, model in channels.items() if not looks_at_rotation(model)}
        if not (orientation and torque):
            channels = {
                name: model for name, model in channels.items() if not isinstance(model, TurnResistance)
            }
        if contact:
            kinds = tuple(kind for kind in self.kinds if transport or kind.contact != "transport")
        else:
            kinds = MOVEMENT
        turns = any(map(looks_at_rotation, channels.values()))
        kinds = tuple(
            replace(kind, channels=tuple(channel for channel in kind.channels if channel in channels))
            for kind in kinds
            if turns or kind.name != "turning"
        )
        kinds = _united(kind for kind in kinds if {*kind.channels} - {"corner"})
        if not kinds:
            raise ValueError(
                f"preset {self.name!r} looks at the force only, expected a wrench that shows contact"
            )
        used = {channel for kind in kinds for channel in kind.channels}
        channels = {name: model for name, model in channels.items() if name in used}
        choice: Choice = "maximum" if self.maximum else "mixture"
        return SegmentModelSet(channels, kinds, choice, self.unrepeated, self.power, self.continuous)

    def online(
        self,
        *,
        contact: bool = True,
        transport: bool = True,
        orientation: bool = False,
        torque: bool = False,
        bias_n: float = SENSOR_BIAS_N,
    ) -> ChangepointFilter:
        """Return a new filter of this preset; arguments as for `lattice`."""
        lattice = self.lattice(
            contact=contact, transport=transport, orientation=orientation, torque=torque, bias_n=bias_n
        )
        return make_filter(lattice, self.hazard, self.filter)

    def has_kind_in(self, contact: ContactState) -> bool:
        """Whether the preset has a kind of segment in this contact state."""
        return any(kind.contact == contact for kind in self.kinds)

    @property
    def hazard(self) -> Hazard:
        """The prior of segment lengths, in samples."""
        mean, early = self.mean_segment_s * SEGMENTATION_HZ, round(self.refractory_s * SEGMENTATION_HZ)
        return Refractory(mean, early, single=self.single_share) if early else Geometric(mean)


def _united(kinds: Iterable[SegmentKind]) -> tuple[SegmentKind, ...]:
    """Return the kinds with those that differ in weight alone united; weights add up."""
    weights: dict[SegmentKind, float] = {}
    for kind in kinds:
        alike = replace(kind, weight=1.0)
        weights[alike] = weights.get(alike, 0.0) + kind.weight
    return tuple(replace(kind, weight=weight) for kind, weight in weights.items())


def looks_at_rotation(model: ChannelModel) -> bool:
    """Return whether a channel model needs an orientation."""
    return isinstance(model, TurnInPlace) or getattr(model, "channel", None) == "rotation"
