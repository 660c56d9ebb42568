"""Parameter sets by name: the thesis' tables, and ours.

A preset says which kinds of segment there are and what every channel is expected to do in them. What the
thesis leaves open (hazard, pruning, window, minimum time) is named here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from caesura_service.changepoint.contact import ContactShare
from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.lattice import Kind, Lattice
from caesura_service.changepoint.levels import Biased, Carried, Constant, Held, Laden
from caesura_service.changepoint.models import ChannelModel, Noise
from caesura_service.changepoint.online import FilterParameters, OnlineFilter
from caesura_service.changepoint.profiled import Profiled, Target
from caesura_service.changepoint.profiles import (
    Profile,
    ProfileLibrary,
    first_order,
    lognormal,
    minimum_jerk,
    overdamped,
)
from caesura_service.changepoint.trend import ConstantVelocity
from caesura_service.changepoint.walk import Walk

SEGMENTATION_HZ = 10.0
STEP_S = 1.0 / SEGMENTATION_HZ
TARED_BIAS_N = 1.5  # what wanders within a recording
UNTARED_BIAS_N = 5.0  # real sensors that were not tared read 1–5 N in free space

# What is left where the force cannot tell contact.
MOVEMENT = (Kind("motion", "motion", "free", ("moving",)), Kind("steady", "steady", "free", ("still",)))


@dataclass(frozen=True)
class Preset:
    """How a demonstration is segmented.

    channels: the channel models, given the scale of the force's bias [N]; kinds: of the whole lattice;
    `mean_segment_s` [s] sets the hazard; segments shorter than `least_segment_s` [s] become no app (the
    thesis' minimum time filter). `continuous`: a segment begins where the one before it ends, at its last
    sample, and there the changepoint lies in time; otherwise it begins with its own first sample, as in the
    thesis. `threshold` on the smoothed probability decides what is a changepoint, as in the thesis; without
    one the best segmentation does.
    """

    name: str
    channels: Callable[[float], Mapping[str, ChannelModel]]
    kinds: tuple[Kind, ...]
    maximum: bool = False
    continuous: bool = False
    mean_segment_s: float = 2.0
    least_segment_s: float = 0.3
    threshold: float | None = None
    filter: FilterParameters = field(default_factory=FilterParameters)

    def lattice(
        self, *, contact: bool = True, transport: bool = True, bias_n: float = TARED_BIAS_N
    ) -> Lattice:
        """The lattice over what the wrench can carry.

        Without contact the force is not looked at, and what remains is whether the arm moves. bias_n [N]:
        scale of what free space may read. Raises ValueError where nothing is left to look at.
        """
        channels = self.channels(bias_n)
        if contact:
            kinds = tuple(kind for kind in self.kinds if transport or kind.contact != "transport")
        else:
            kinds = tuple(kind for kind in MOVEMENT if set(kind.channels) <= set(channels))
        if not kinds:
            raise ValueError(
                f"preset {self.name!r} looks at the force only, expected a wrench that tells contact"
            )
        used = {channel for kind in kinds for channel in kind.channels}
        channels = {name: model for name, model in channels.items() if name in used}
        return Lattice(channels, kinds, "maximum" if self.maximum else "mixture")

    def online(
        self, *, contact: bool = True, transport: bool = True, bias_n: float = TARED_BIAS_N
    ) -> OnlineFilter:
        """A filter at its beginning; arguments as for `lattice`."""
        hazard = Geometric(self.mean_segment_s * SEGMENTATION_HZ)
        lattice = self.lattice(contact=contact, transport=transport, bias_n=bias_n)
        return OnlineFilter(lattice, hazard, self.filter)


def thesis_motion_library() -> ProfileLibrary:
    """30 overdamped profiles, Λ = 1. Thesis Tab. 4.2."""
    pairs = [(k, d) for k in (4, 8, 12, 16, 20, 24) for d in (10, 32.5, 55, 77.5, 100)]
    return ProfileLibrary([overdamped(k, d) for k, d in pairs], STEP_S)


def thesis_force_library() -> ProfileLibrary:
    """21 first-order rises, rates e^0 to e^3 per second. Thesis Tab. 4.3."""
    return ProfileLibrary([first_order(float(np.exp(0.15 * i))) for i in range(21)], STEP_S)


def _integrated_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {
        "moving": Profiled("position", thesis_motion_library(), Noise(1.0, 0.025), "maximum"),
        "still": Constant("position", Noise(1.0, 0.025)),
        "untouched": Constant("force", Noise(1.0, 0.5), origin="zero"),
        "pressed": Profiled("force", thesis_force_library(), Noise(1.0, 1.25), "maximum", origin="zero"),
        "loaded": Carried(Noise(1.0, 0.5), least_kg=0.2),
    }


def _constant_velocity_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {"moving": ConstantVelocity(nu0=1.0, sigma2=0.5, kappa0=1.0, length_unit_m=0.01, step_s=STEP_S)}


def _second_order_channels(sigma_m: float) -> Callable[[float], Mapping[str, ChannelModel]]:
    def channels(bias_n: float) -> Mapping[str, ChannelModel]:
        return {"moving": Profiled("position", thesis_motion_library(), Noise(1.0, sigma_m), "maximum")}

    return channels


def _force_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    rise = Profiled("force", thesis_force_library(), Noise(10.0, 1.25), "maximum", origin="zero")
    return {"pressed": rise}


def _contact_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {name: ContactShare(state) for state, name in enumerate(("free", "contact", "transport"))}


def correlation(time_s: float) -> float:
    """Correlation of neighbouring observations of a process that forgets with this time constant [s]."""
    return float(np.exp(-STEP_S / time_s))


# How long residuals stay alike: what a person does wrong on the way he does for about one submovement, and
# a sensor's bias wanders with the pose, that is with the movement.
MEMORY_S = 0.5
DURATIONS_S = np.geomspace(0.4, 5.0, 16)  # of movements; real ones last 0.3–3.4 s
CALM = 0.3  # a movement's residuals at rest, as a share of those at its fastest


def even_moves() -> list[Profile]:
    """Minimum jerk: the speed is a symmetric bell. Flash & Hogan 1985."""
    return [minimum_jerk(float(duration)) for duration in DURATIONS_S]


def early_moves() -> list[Profile]:
    """Lognormal speed: fast at first, then a long tail. Plamondon 1995."""
    return [lognormal(float(duration)) for duration in DURATIONS_S]


def human_motion_library() -> ProfileLibrary:
    """Movements of 16 durations, even and early ones."""
    return ProfileLibrary([*even_moves(), *early_moves()], STEP_S, correlation(MEMORY_S), CALM)


def _default_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    """Scales from what sensors and hands do (statistics of real recordings), none from our scenarios.

    A hand at rest keeps within 0.3–1 mm and shifts by a tenth of that from one observation to the next;
    slower than 5 mm/s is rest. A wrench is uncertain by 0.1–1 N while the arm moves; its bias wanders by
    2.3 N within a recording. A path leaves its profile by about 4 % of its length, give or take a half. How
    much is known to about a third (nu0 = 5: the log scale has a deviation of 1/√(2 nu0)). A teacher reaches
    0.2 m, give or take a factor of two.
    """
    path = Noise(nu0=5.0, floor=0.0007, shares=(0.02, 0.06), joint=True, correlation=correlation(MEMORY_S))
    quiet = Noise(nu0=5.0, floor=0.5, joint=True, correlation=correlation(MEMORY_S))
    slow = 0.005 * STEP_S
    beyond = 2.0 * bias_n  # a force that the bias does not explain
    return {
        "moving": Profiled(
            "position", human_motion_library(), path, origin="previous", target=Target(0.2, 0.005), pace=slow
        ),
        "still": Walk("position", scale=0.0001, still=slow),
        "stopped": Walk("position", scale=0.0001),
        "untouched": Biased(quiet, bias=bias_n, absence=beyond),
        "pressed": Walk("force", scale=0.5, presence=beyond),
        "laden": Laden(quiet, bias=bias_n, absence=beyond),
        "empty": Held(0.03),
        "gripping": Held(0.5, change=0.05),
        "holding": Held(0.97),
    }


_MOTION_ONLY = (Kind("motion", "motion", "free", ("moving",)),)
_FORCE_ONLY = (Kind("contact", "steady", "contact", ("pressed",)),)
_CONTACT_ONLY = (
    Kind("motion", "motion", "free", ("free",)),
    Kind("contact", "steady", "contact", ("contact",)),
    Kind("transport", "motion", "transport", ("transport",)),
)
_THESIS_KINDS = (
    Kind("motion", "motion", "free", ("moving", "untouched")),
    Kind("contact", "steady", "contact", ("still", "pressed")),
    Kind("transport", "motion", "transport", ("moving", "loaded")),
)
# Without a gripper that says so, a hand is empty: a load and a wandering bias look alike.
_LADEN_WEIGHT = 0.2
_ALL_KINDS = (
    Kind("motion", "motion", "free", ("moving", "untouched", "empty")),
    Kind("steady", "steady", "free", ("still", "untouched", "empty")),
    Kind("sliding", "motion", "contact", ("moving", "pressed", "gripping")),
    Kind("contact", "steady", "contact", ("stopped", "pressed", "gripping")),
    Kind("transport", "motion", "transport", ("moving", "laden", "holding"), _LADEN_WEIGHT),
    Kind("hold", "steady", "transport", ("still", "laden", "holding"), _LADEN_WEIGHT),
)

PRESETS: Mapping[str, Preset] = {
    preset.name: preset
    for preset in (
        Preset("constant_velocity", _constant_velocity_channels, _MOTION_ONLY),
        Preset("second_order_1", _second_order_channels(0.05), _MOTION_ONLY),
        Preset("second_order_2", _second_order_channels(0.025), _MOTION_ONLY),
        Preset("force", _force_channels, _FORCE_ONLY),
        Preset("contact", _contact_channels, _CONTACT_ONLY),
        Preset("integrated", _integrated_channels, _THESIS_KINDS, maximum=True),
        Preset("default", _default_channels, _ALL_KINDS, continuous=True),
    )
}


def preset(name: str) -> Preset:
    """The preset of that name. Raises KeyError naming those that exist."""
    if name not in PRESETS:
        raise KeyError(f"no preset {name!r}; known: {sorted(PRESETS)}")
    return PRESETS[name]
