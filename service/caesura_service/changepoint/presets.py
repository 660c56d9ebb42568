"""Parameter sets by name: the thesis' tables, and ours.

A preset says which kinds of segment there are and what every channel is expected to do in them. What the
thesis leaves open (hazard, pruning, window, minimum time) is named here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from caesura_service.changepoint.hazard import Geometric
from caesura_service.changepoint.lattice import Kind, Lattice
from caesura_service.changepoint.levels import Biased, Carried, Constant, Held, Laden
from caesura_service.changepoint.models import ChannelModel, Noise
from caesura_service.changepoint.online import FilterParameters, OnlineFilter
from caesura_service.changepoint.profiled import Profiled
from caesura_service.changepoint.profiles import ProfileLibrary, first_order, minimum_jerk, overdamped

SEGMENTATION_HZ = 10.0
STEP_S = 1.0 / SEGMENTATION_HZ


@dataclass(frozen=True)
class Preset:
    """How a demonstration is segmented.

    channels and kinds: of the whole lattice; `mean_segment_s` [s] sets the hazard; segments shorter than
    `least_segment_s` [s] become no app (the thesis' minimum time filter). `continuous`: a segment begins
    where the one before it ends, at its last sample, and there the changepoint lies in time; otherwise it
    begins with its own first sample, as in the thesis.
    """

    name: str
    channels: Callable[[], Mapping[str, ChannelModel]]
    kinds: tuple[Kind, ...]
    maximum: bool = False
    tempering: float = 1.0
    continuous: bool = False
    mean_segment_s: float = 2.0
    least_segment_s: float = 0.3
    filter: FilterParameters = field(default_factory=FilterParameters)

    def lattice(self, *, contact: bool = True, transport: bool = True) -> Lattice:
        """The lattice over what the wrench can carry.

        Without contact the force is not looked at, and what remains is whether the arm moves.
        """
        kinds = tuple(kind for kind in self.kinds if transport or kind.contact != "transport")
        if not contact:
            kinds = (
                Kind("motion", "motion", "free", ("moving",)),
                Kind("steady", "steady", "free", ("still",)),
            )
        used = {channel for kind in kinds for channel in kind.channels}
        channels = {name: model for name, model in self.channels().items() if name in used}
        return Lattice(channels, kinds, "maximum" if self.maximum else "mixture", self.tempering)

    def online(self, *, contact: bool = True, transport: bool = True) -> OnlineFilter:
        """A filter at its beginning."""
        hazard = Geometric(self.mean_segment_s * SEGMENTATION_HZ)
        return OnlineFilter(self.lattice(contact=contact, transport=transport), hazard, self.filter)


def thesis_motion_library() -> ProfileLibrary:
    """30 overdamped profiles, Λ = 1. Thesis Tab. 4.2."""
    pairs = [(k, d) for k in (4, 8, 12, 16, 20, 24) for d in (10, 32.5, 55, 77.5, 100)]
    return ProfileLibrary([overdamped(k, d) for k, d in pairs], STEP_S)


def thesis_force_library() -> ProfileLibrary:
    """21 first-order rises, rates e^0 to e^3 per second. Thesis Tab. 4.3."""
    return ProfileLibrary([first_order(float(np.exp(0.15 * i))) for i in range(21)], STEP_S)


def _integrated_channels() -> Mapping[str, ChannelModel]:
    return {
        "moving": Profiled("position", thesis_motion_library(), Noise(1.0, 0.025), "maximum"),
        "still": Constant("position", Noise(1.0, 0.025)),
        "untouched": Constant("force", Noise(1.0, 0.5), origin="zero"),
        "pressed": Profiled("force", thesis_force_library(), Noise(1.0, 1.25), "maximum", origin="zero"),
        "loaded": Carried(Noise(1.0, 0.5), least_kg=0.2),
    }


def correlation(time_s: float) -> float:
    """Correlation of neighbouring observations of a process that forgets with this time constant [s]."""
    return float(np.exp(-STEP_S / time_s))


# What a person does wrong on the way stays for about one submovement; half the power of the force of a
# guiding hand lies below 0.8 Hz, which is a time constant of 1/(2π 0.8 Hz).
PATH_MEMORY_S = 0.5
FORCE_MEMORY_S = 0.2


def human_motion_library() -> ProfileLibrary:
    """Minimum-jerk moves of 16 durations from 0.4 s to 5 s. Flash & Hogan 1985; real moves last 0.3–3.4 s."""
    moves = [minimum_jerk(float(duration)) for duration in np.geomspace(0.4, 5.0, 16)]
    return ProfileLibrary(moves, STEP_S, correlation(PATH_MEMORY_S))


def human_force_library() -> ProfileLibrary:
    """First-order changes of force, from within a sample to about a second: contact rises within 0.1 s."""
    changes = [first_order(float(rate)) for rate in np.geomspace(1.0, 40.0, 10)]
    return ProfileLibrary(changes, STEP_S, correlation(FORCE_MEMORY_S))


def _default_channels() -> Mapping[str, ChannelModel]:
    """Scales from what sensors and hands do, none from our scenarios.

    A hand at rest keeps within 0.3–1 mm, a moving arm's wrench is uncertain by 0.1–1 N, both known to about
    a quarter (nu0 = 10: the log scale has a deviation of 1/√(2 nu0)). A path leaves its profile by about
    4 % of its length and a pressing hand its level by about a fifth, which says little about one movement
    (nu0 = 2). A teacher reaches 0.2 m and presses with 10 N, give or take a factor of two.
    """
    path = Noise(nu0=2.0, floor=0.0007, share=0.04, joint=True, correlation=correlation(PATH_MEMORY_S))
    rest = replace(path, nu0=10.0, share=0.0)
    push = Noise(nu0=10.0, floor=0.5, share=0.2, joint=True, correlation=correlation(FORCE_MEMORY_S))
    quiet = replace(push, share=0.0)
    return {
        "moving": Profiled("position", human_motion_library(), path, origin="previous", reach=0.2),
        "still": Constant("position", rest, origin="previous"),
        "untouched": Biased(quiet, bias=1.5),
        "pressed": Profiled("force", human_force_library(), push, origin="previous", reach=10.0),
        "laden": Laden(quiet, bias=1.5),
        "empty": Held(0.03),
        "gripping": Held(0.5, change=0.05),
        "holding": Held(0.97),
    }


_THESIS_KINDS = (
    Kind("motion", "motion", "free", ("moving", "untouched")),
    Kind("contact", "steady", "contact", ("still", "pressed")),
    Kind("transport", "motion", "transport", ("moving", "loaded")),
)
_ALL_KINDS = (
    Kind("motion", "motion", "free", ("moving", "untouched", "empty")),
    Kind("steady", "steady", "free", ("still", "untouched", "empty")),
    Kind("sliding", "motion", "contact", ("moving", "pressed", "gripping")),
    Kind("contact", "steady", "contact", ("still", "pressed", "gripping")),
    Kind("transport", "motion", "transport", ("moving", "laden", "holding")),
    Kind("hold", "steady", "transport", ("still", "laden", "holding")),
)

PRESETS: Mapping[str, Preset] = {
    preset.name: preset
    for preset in (
        Preset("integrated", _integrated_channels, _THESIS_KINDS, maximum=True),
        Preset("default", _default_channels, _ALL_KINDS, continuous=True),
    )
}


def preset(name: str) -> Preset:
    """The preset of that name. Raises KeyError naming those that exist."""
    if name not in PRESETS:
        raise KeyError(f"no preset {name!r}; known: {sorted(PRESETS)}")
    return PRESETS[name]
