"""Our own preset, all six kinds of segment, and what each of its principles is worth.

DESIGN, "What real robots teach": noise from the sensor, misfit that grows with the movement, free space with
a bias, contact as a change, correlated residuals. A sixth is that speed tells movement from rest, a seventh
that a surface never drives whoever slides along it. `WITHOUT` has each left out, everything else being as
it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from caesura_service.changepoint.friction import Friction
from caesura_service.changepoint.lattice import Kind
from caesura_service.changepoint.levels import Biased, Constant, Held, Laden
from caesura_service.changepoint.models import ChannelModel, Noise
from caesura_service.changepoint.preset import STEP_S, Preset
from caesura_service.changepoint.profiled import Profiled, Target
from caesura_service.changepoint.profiles import Profile, ProfileLibrary, lognormal, minimum_jerk
from caesura_service.changepoint.thesis_presets import thesis_force_library
from caesura_service.changepoint.walk import Walk


def correlation(time_s: float) -> float:
    """Correlation of neighbouring observations of a process that forgets with this time constant [s]."""
    return float(np.exp(-STEP_S / time_s))


# How long residuals stay alike: what a person does wrong on the way he does for about one submovement, and
# a sensor's bias wanders with the pose, that is with the movement.
MEMORY_S = 0.5
DURATIONS_S = np.geomspace(0.4, 5.0, 16)  # of movements; real ones last 0.3–3.4 s
REFRACTORY_S = 0.2  # the shortest submovements; nobody does two things within one
REST_STEP_M = 0.0001  # by which a resting hand shifts from one observation to the next
QUIET = Noise(nu0=5.0, floor=0.5, joint=True, correlation=correlation(MEMORY_S))  # of a wrench [N]
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


def default_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    """Scales from what sensors and hands do (statistics of real recordings), none from our scenarios.

    A hand at rest keeps within 0.3–1 mm and shifts by a tenth of that from one observation to the next;
    slower than 5 mm/s is rest. A wrench is uncertain by 0.1–1 N while the arm moves; its bias wanders by
    2.3 N within a recording. A path leaves its profile by about 4 % of its length, give or take a half. How
    much is known to about a third (nu0 = 5: the log scale has a deviation of 1/√(2 nu0)). A teacher reaches
    0.2 m, give or take a factor of two.
    """
    path = Noise(nu0=5.0, floor=0.0007, shares=(0.02, 0.06), joint=True, correlation=correlation(MEMORY_S))
    slow = 0.005 * STEP_S
    beyond = 2.0 * bias_n  # a force that the bias does not explain
    return {
        "moving": Profiled(
            "position", human_motion_library(), path, origin="previous", target=Target(0.2, 0.005), pace=slow
        ),
        "still": Walk("position", scale=REST_STEP_M, still=slow),
        "stopped": Walk("position", scale=REST_STEP_M),
        "untouched": Biased(QUIET, bias=bias_n, absence=beyond),
        "pressed": Walk("force", scale=0.5, presence=beyond),
        "slid_along": Friction(least=beyond, pace=slow),
        "laden": Laden(QUIET, bias=bias_n, absence=beyond),
        "empty": Held(0.03),
        "gripping": Held(0.5, change=0.05),
        "holding": Held(0.97),
    }


# Where no gripper tells, a hand is empty nine times of ten: a load and a wandering bias look alike.
_LADEN_WEIGHT = 0.1
ALL_KINDS = (
    Kind("motion", "motion", "free", ("moving", "untouched", "empty")),
    Kind("steady", "steady", "free", ("still", "untouched", "empty")),
    Kind("sliding", "motion", "contact", ("moving", "pressed", "slid_along", "gripping")),
    Kind("contact", "steady", "contact", ("stopped", "pressed", "gripping")),
    Kind("transport", "motion", "transport", ("moving", "laden", "holding"), _LADEN_WEIGHT),
    Kind("hold", "steady", "transport", ("still", "laden", "holding"), _LADEN_WEIGHT),
)

DEFAULT = Preset("default", default_channels, ALL_KINDS, continuous=True, refractory_s=REFRACTORY_S)

Channels = Mapping[str, ChannelModel]


def _moving(bias_n: float) -> Profiled:
    moving = default_channels(bias_n)["moving"]
    assert isinstance(moving, Profiled)
    return moving


def _thesis_scales(bias_n: float) -> Channels:
    """25 mm and 1.25 N whatever the sensor, Tab. 4.5."""
    moving = _moving(bias_n)
    place = Constant("position", Noise(1.0, 0.025, joint=True), origin="previous")
    return {
        "moving": replace(moving, noise=replace(moving.noise, nu0=1.0, floor=0.025)),
        "still": place,
        "stopped": place,
        "pressed": Walk("force", scale=1.25, presence=2.0 * bias_n),
    }


def _even_misfit(bias_n: float) -> Channels:
    """The same however far and fast a movement goes."""
    moving = _moving(bias_n)
    even = replace(moving.library, calm=1.0)
    return {"moving": replace(moving, library=even, noise=replace(moving.noise, shares=(0.0,)))}


def _unbiased(bias_n: float) -> Channels:
    """Free space reads zero."""
    return {"untouched": Constant("force", QUIET, origin="zero")}


def _rising_contact(bias_n: float) -> Channels:
    """A contact is a rise from zero, (3.36)–(3.45)."""
    rise = Profiled("force", thesis_force_library(), Noise(10.0, 1.25), origin="zero")
    return {"pressed": rise}


def _white(bias_n: float) -> Channels:
    """What is left over is new at every observation."""
    moving, white = _moving(bias_n), replace(QUIET, correlation=0.0)
    place = Constant("position", replace(moving.noise, shares=(0.0,), correlation=0.0), origin="previous")
    return {
        "moving": replace(
            moving,
            library=replace(moving.library, correlation=0.0),
            noise=replace(moving.noise, correlation=0.0),
        ),
        "still": place,
        "stopped": place,
        "untouched": Biased(white, bias=bias_n, absence=2.0 * bias_n),
        "pressed": Constant("force", white, origin="previous"),
        "laden": Laden(white, bias=bias_n, absence=2.0 * bias_n),
    }


def _paceless(bias_n: float) -> Channels:
    """Movement and rest differ by their course alone."""
    return {"moving": replace(_moving(bias_n), pace=0.0), "still": Walk("position", scale=REST_STEP_M)}


def _frictionless(bias_n: float) -> Channels:
    """Whoever moves under a force that no bias explains slides, wherever that points."""
    return {"slid_along": Friction(least=0.0, pace=0.005 * STEP_S)}


def _with(changes: Callable[[float], Channels], bias_n: float) -> Channels:
    return {**default_channels(bias_n), **changes(bias_n)}


WITHOUT: Mapping[str, Preset] = {
    preset.name: preset
    for preset in (
        replace(DEFAULT, name=f"without_{principle}", channels=partial(_with, changes))
        for principle, changes in (
            ("sensor_noise", _thesis_scales),
            ("growing_misfit", _even_misfit),
            ("bias", _unbiased),
            ("change", _rising_contact),
            ("correlation", _white),
            ("pace", _paceless),
            ("friction", _frictionless),
        )
    )
}
