"""The thesis' models with the parameters of its tables 4.1 to 4.5.

The thesis prints two ν0 for a press: 10 in Tab. 4.3 (force model), 1 in Tab. 4.5 (integrated model). Its
section 3.2.4 defines the press of the integrated model "similar to" the press of the force model.
`integrated` takes 10, because the published segmentation (Fig. 4.17) comes out with 10 and not with 1.
`integrated_tab_4_5` takes 1, as printed. docs/thesis.md has the figures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from caesura_service.changepoint.channel_model import ChannelModel, Noise
from caesura_service.changepoint.constant_models import ConstantLevel, ThesisLoadForce
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.contact_mixture import ContactMixture
from caesura_service.changepoint.preset import STEP_S, Preset
from caesura_service.changepoint.profile_library import ProfileLibrary, first_order, overdamped
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.segment_model_set import SegmentKind

PRESS = Noise(10.0, 1.25)  # [N] thesis Tab. 4.3
PRESS_TAB_4_5 = Noise(1.0, 1.25)  # [N] thesis Tab. 4.5


def thesis_motion_library() -> ProfileLibrary:
    """30 overdamped profiles, Λ = 1. Thesis Tab. 4.2."""
    pairs = [(k, d) for k in (4, 8, 12, 16, 20, 24) for d in (10, 32.5, 55, 77.5, 100)]
    return ProfileLibrary([overdamped(k, d) for k, d in pairs], STEP_S)


def thesis_force_library() -> ProfileLibrary:
    """21 first-order rises, rates e^0 to e^3 per second. Thesis Tab. 4.3."""
    return ProfileLibrary([first_order(float(np.exp(0.15 * i))) for i in range(21)], STEP_S)


def _integrated_channels(press: Noise) -> Callable[[float], Mapping[str, ChannelModel]]:
    def channels(bias_n: float) -> Mapping[str, ChannelModel]:
        return {
            "moving": ProfileModel("position", thesis_motion_library(), Noise(1.0, 0.025), "maximum"),
            "still": ConstantLevel("position", Noise(1.0, 0.025)),
            "untouched": ConstantLevel("force", Noise(1.0, 0.5), origin="zero"),
            "pressed": _pressed(press),
            "loaded": ThesisLoadForce(Noise(1.0, 0.5), least_kg=0.2),
        }

    return channels


def _pressed(noise: Noise) -> ProfileModel:
    return ProfileModel("force", thesis_force_library(), noise, "maximum", origin="zero")


def _constant_velocity_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {"moving": ConstantVelocity(nu0=1.0, sigma2=0.5, kappa0=1.0, length_unit_m=0.01, step_s=STEP_S)}


def _second_order_channels(sigma_m: float) -> Callable[[float], Mapping[str, ChannelModel]]:
    def channels(bias_n: float) -> Mapping[str, ChannelModel]:
        return {"moving": ProfileModel("position", thesis_motion_library(), Noise(1.0, sigma_m), "maximum")}

    return channels


def _force_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {"pressed": _pressed(PRESS)}


def _contact_channels(bias_n: float) -> Mapping[str, ChannelModel]:
    return {name: ContactMixture(state) for state, name in enumerate(("free", "contact", "transport"))}


_MOTION_ONLY = (SegmentKind("motion", "motion", "free", ("moving",)),)
_FORCE_ONLY = (SegmentKind("contact", "steady", "contact", ("pressed",)),)
_CONTACT_ONLY = (
    SegmentKind("motion", "motion", "free", ("free",)),
    SegmentKind("contact", "steady", "contact", ("contact",)),
    SegmentKind("transport", "motion", "transport", ("transport",)),
)
_THESIS_KINDS = (
    SegmentKind("motion", "motion", "free", ("moving", "untouched")),
    SegmentKind("contact", "steady", "contact", ("still", "pressed")),
    SegmentKind("transport", "motion", "transport", ("moving", "loaded")),
)

THESIS_PRESETS = (
    Preset("constant_velocity", _constant_velocity_channels, _MOTION_ONLY),
    Preset("second_order_1", _second_order_channels(0.05), _MOTION_ONLY),
    Preset("second_order_2", _second_order_channels(0.025), _MOTION_ONLY),
    Preset("force", _force_channels, _FORCE_ONLY),
    Preset("contact", _contact_channels, _CONTACT_ONLY),
    Preset("integrated", _integrated_channels(PRESS), _THESIS_KINDS, maximum=True),
    Preset("integrated_tab_4_5", _integrated_channels(PRESS_TAB_4_5), _THESIS_KINDS, maximum=True),
)
