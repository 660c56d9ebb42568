"""Converts a model set to the arrays of `layout.py`: a record per channel, and tables of terms that depend on
length alone.

There is one function per channel model. A model without one, or with an option that the kernels do not
implement, cannot be compiled (`can_compile`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from caesura_service.changepoint.channel_model import AXES, Channel, ChannelModel, Noise, Origin
from caesura_service.changepoint.constant_models import (
    ConstantLevel,
    FreeSpaceForce,
    GripperHoldingChain,
    LoadForce,
    ThesisLoadForce,
)
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.contact_mixture import ContactMixture
from caesura_service.changepoint.continued_level import ContinuedLevel
from caesura_service.changepoint.corner_weight import CornerWeight
from caesura_service.changepoint.dissipative_contact import DissipativeContactWeight
from caesura_service.changepoint.evidence import student_log_density
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.force_rise_penalty import NoContactRise
from caesura_service.changepoint.guided_motion import GuidedMotion
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.kernels import layout
from caesura_service.changepoint.kernels.layout import (
    BLOCK,
    CHANNEL,
    FORCE,
    MOST_CHORDS,
    MOST_SHARES,
    PAST,
    POSITION,
    ROTATION,
    SETTINGS,
    Floats,
    Ints,
    Model,
)
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.random_walk import StudentRandomWalk
from caesura_service.changepoint.segment_model_set import SegmentModelSet
from caesura_service.changepoint.step_size_weight import StepSizeWeight
from caesura_service.changepoint.traced_motion import TracedMotion
from caesura_service.changepoint.turn_in_place import TurnInPlace
from caesura_service.changepoint.turn_resistance import LEAST_FORCE_N, TurnResistance
from caesura_service.constants import GRAVITY

Record = Mapping[str, Any]
MOST_LENGTHS = 4096  # that are tabled; for what is longer the logarithm is taken anew
SIGNALS: Mapping[Channel, int] = {"position": POSITION, "force": FORCE, "rotation": ROTATION}
ORIGINS: Mapping[Origin, int] = {"previous": layout.PREVIOUS, "first": layout.FIRST, "zero": layout.ZERO}


def can_compile(lattice: SegmentModelSet) -> bool:
    """Return whether every channel model has a compiled implementation."""
    return all(type(model) in RECORDS and _fits(model) for model in lattice.channels.values())


def _fits(model: ChannelModel) -> bool:
    """Return whether the options of a model fit into the fixed sizes of the arrays."""
    match model:
        case GuidedMotion() | TracedMotion():
            return len(model.scales) <= MOST_SHARES and model.away_steps < PAST
        case ContinuedLevel():
            return model.memory < PAST and type(model.level) in (FreeSpaceForce, LoadForce)
        case CornerWeight():
            return model.memory <= PAST and len(model.chords) <= MOST_CHORDS
        case _:
            return len(_noise(model).shares) <= MOST_SHARES


def model_of(lattice: SegmentModelSet, hazard: Hazard, parameters: FilterParameters, lengths: int) -> Model:
    """Return the lattice as arrays, with tables for segments of up to `lengths` samples."""
    models = tuple(lattice.channels.values())
    n, channels = np.arange(lengths + 1), _channels(models)
    return Model(
        _settings(lattice, parameters),
        channels,
        np.array([[name in kind.channels for name in lattice.channels] for kind in lattice.kinds]),
        lattice.log_weight,
        np.ascontiguousarray(lattice.groups),
        np.ascontiguousarray(lattice.log_transition),
        *_stacked([model for model in models if isinstance(model, ProfileModel)], n),
        np.array([by_length(channel, n[:MOST_LENGTHS]) for channel in channels]),
        np.stack([one.log_mass(np.maximum(n, 1)) for one in (hazard, hazard.residual)]),
        np.stack([one.log_survival(n) for one in (hazard, hazard.residual)]),
    )


def fields_of(lattice: SegmentModelSet) -> int:
    """Return the number of sums that a hypothesis keeps."""
    return sum(_width(model) for model in lattice.channels.values())


def profiled_of(lattice: SegmentModelSet) -> tuple[int, int]:
    """Return the number of channels with profiles, and the most blocks of profiles that one of them has."""
    blocks = [_blocks(model) for model in lattice.channels.values() if isinstance(model, ProfileModel)]
    return len(blocks), max(blocks, default=0)


def _settings(lattice: SegmentModelSet, p: FilterParameters) -> NDArray[Any]:
    with np.errstate(divide="ignore"):
        prune = np.log(p.prune_ratio)
    maximum = lattice.choice == "maximum"
    return np.array(
        [
            (
                prune,
                p.keep_youngest,
                p.cap,
                p.window,
                p.certain,
                p.certain_after,
                maximum,
                lattice.power,
                lattice.stepwise,
            )
        ],
        SETTINGS,
    )


def _channels(models: Sequence[ChannelModel]) -> NDArray[Any]:
    records = np.zeros(len(models), CHANNEL)
    field = library = 0
    for record, model in zip(records, models, strict=True):
        of_noise = {} if type(model) not in _NOISY else _record_of_noise(_noise(model))
        content = {
            "field": field,
            "library": library,
            **of_noise,
            **RECORDS[type(model)](model),
        }
        for name, value in content.items():
            record[name] = value
        field += _width(model)
        library += isinstance(model, ProfileModel)
    return records


def _stacked(models: Sequence[ProfileModel], n: Ints) -> tuple[Floats, Floats]:
    """Return each model's table up to where all profiles rest, and its continuation."""
    n = n[: 1 + max((model.library.last_row(n.size - 1) for model in models), default=0)]
    blocks = max((_blocks(model) for model in models), default=0)
    tables = np.zeros((len(models), n.size, blocks, 4, BLOCK))
    steps = np.zeros((len(models), blocks, 2, BLOCK))
    for i, model in enumerate(models):
        library, pooled = model.library, AXES if model.noise.joint else 1
        columns = np.minimum(np.arange(blocks * BLOCK), len(library) - 1)
        values, precisions = library.values(n)[:, columns], library.precisions(n)[:, columns]
        scales = library.log_scales(np.maximum(n - (model.target is not None), 0))[:, columns]
        scales[:, len(library) :] = np.inf  # what fills a block up repeats the last one
        rows = (values * precisions, precisions, library.sums_of_squares(n)[:, columns], pooled * scales)
        beyond = (values[-1] ** 2 * precisions[-1], -0.5 * pooled * np.log(precisions[-1]))
        tables[i] = np.stack([row.reshape(n.size, blocks, BLOCK) for row in rows], axis=2)
        steps[i] = np.stack([row.reshape(blocks, BLOCK) for row in beyond], axis=1)
    return tables, steps


def _blocks(model: ProfileModel) -> int:
    return -(-len(model.library) // BLOCK)


# --- channel by channel ---------------------------------------------------------------------------------


def _record_of_noise(noise: Noise) -> Record:
    return {
        "nu0": noise.nu0,
        "rho": noise.correlation,
        "white": 1.0 / np.sqrt(1.0 - noise.correlation**2),
        "floor2": noise.floor**2,
        "joint": noise.joint,
        "shares": len(noise.shares),
        "share2": _padded(np.square(noise.shares), MOST_SHARES),
        "pooled": AXES if noise.joint else 1,
        "whitening": -0.5 * np.log1p(-(noise.correlation**2)) * (AXES if noise.joint else 1),
        "offset": 0.5 * noise.nu0 * np.log(noise.nu0 * noise.floor**2),
    }


def _profile_model(model: ProfileModel) -> Record:
    target, noise, maximum = model.target, model.noise, model.choice == "maximum"
    even = model.library.rest_scale_ratio == 1.0
    best_only = maximum and even and not noise.joint and noise.shares == (0.0,)
    record = {
        "model": layout.PROFILE_MODEL,
        "signal": SIGNALS[model.channel],
        "origin": ORIGINS[model.origin],
        "blocks": _blocks(model),
        "maximum": maximum,
        "even": even,
        "best_only": best_only,
        "pace": model.pace,
        "unwhitened": int(model.origin != "previous"),
    }
    if not best_only:
        record["offset"] = 0.0 if maximum else -np.log(len(model.library) * len(noise.shares))
    if target is None:
        return record
    left_out = (target.least**2 / (target.reach**2 + target.least**2)) ** (AXES / 2)
    constant = -0.5 * AXES * np.log(2.0 * np.pi * target.reach**2) - np.log1p(-left_out)
    return {
        **record,
        "explained": 1,
        "unvalued": 1,
        "unwhitened": 1 + record["unwhitened"],
        "reach2": target.reach**2,
        "least": target.least,
        "constant": constant,
    }


def _random_walk(model: StudentRandomWalk) -> Record:
    return {
        "model": layout.RANDOM_WALK,
        "signal": SIGNALS[model.channel],
        "scale2": model.scale**2,
        "nu": model.nu,
        "still": model.still,
        "presence": model.presence,
        "constant": float(student_log_density(0.0, AXES, model.nu, model.scale)),
    }


def _constant_level(model: ConstantLevel) -> Record:
    return {
        "model": layout.CONSTANT_LEVEL,
        "signal": SIGNALS[model.channel],
        "origin": ORIGINS[model.origin],
        "unwhitened": int(model.origin != "previous"),
    }


def _free_space_force(model: FreeSpaceForce) -> Record:
    return {
        "model": layout.FREE_SPACE_FORCE,
        "signal": FORCE,
        "origin": layout.ZERO,
        "bias2": model.bias**2,
        "absence": model.absence,
        "lightest": model.least_kg * GRAVITY,
        "heaviest": model.most_kg * GRAVITY,
        "unvalued": 1,
        "unwhitened": 1,
    }


def _load_force(model: LoadForce) -> Record:
    return {**_free_space_force(model), "model": layout.LOAD_FORCE}


def _continued_level(model: ContinuedLevel) -> Record:
    whether = {
        "memory": model.memory,
        "log_continued": np.log(model.probability),
        "away": model.away,
    }
    return {**RECORDS[type(model.level)](model.level), **whether}


def _thesis_load_force(model: ThesisLoadForce) -> Record:
    weight = model.least_kg * GRAVITY
    return {"model": layout.THESIS_LOAD_FORCE, "signal": FORCE, "lightest": weight, "whitening": 0.0}


def _gripper_holding(model: GripperHoldingChain) -> Record:
    return {"model": layout.GRIPPER_HOLDING, "probability": model.probability, "change": model.change}


def _contact_mixture(model: ContactMixture) -> Record:
    return {
        "model": layout.CONTACT_MIXTURE,
        "signal": FORCE,
        "state": model.state,
        "variance": model.sensor2 + np.array([0.0, model.contact2, model.transport2]),
        "alpha": model.alpha,
        "lightest": model.least_kg * GRAVITY,
    }


def _constant_velocity(model: ConstantVelocity) -> Record:
    return {
        "model": layout.CONSTANT_VELOCITY,
        "signal": SIGNALS["position"],
        "nu0": model.nu0,
        "floor2": model.sigma2,
        "kappa0": model.kappa0,
        "unit": model.length_unit_m,
        "step": model.step_s,
        "pooled": 1,
        "offset": np.log(model.kappa0) + 0.5 * model.nu0 * np.log(model.nu0 * model.sigma2),
    }


def _dissipative_contact(model: DissipativeContactWeight) -> Record:
    return {"model": layout.DISSIPATIVE_CONTACT, "least": model.least, "pace": model.pace}


def _guided_motion(model: GuidedMotion) -> Record:
    return {
        **_movement(model),
        "model": layout.GUIDED_MOTION,
        "rho": model.correlation,
        "scale2": model.share**2,
        "burst2": model.burst**2,
        "burst_steps": model.burst_steps,
        "pace": model.pace,
    }


def _traced_motion(model: TracedMotion) -> Record:
    return {
        **_movement(model),
        "model": layout.TRACED_MOTION,
        "rho": model.discount,
        "reach2": (model.speed / model.floor) ** 2,
    }


def _movement(model: GuidedMotion | TracedMotion) -> Record:
    """Return the fields of a movement's record: those of its noise per step, and of its displacement."""
    return {
        "signal": SIGNALS["position"],
        "nu": model.nu,
        "constant": float(student_log_density(0.0, AXES, model.nu, 1.0)),
        "floor2": model.floor**2,
        "shares": len(model.scales),
        "share2": _padded(np.square(model.scales), MOST_SHARES),
        "away": model.away,
        "away_steps": model.away_steps,
    }


def _corner_weight(model: CornerWeight) -> Record:
    return {
        "model": layout.CORNER_WEIGHT,
        "signal": SIGNALS[model.channel],
        "gamma": model.gamma,
        "standing": model.standing,
        "fast2": model.fast**2,
        "pace": model.pace,
        "turn": model.turn_deg,
        "turn_width": model.turn_width_deg,
        "dip": model.dip,
        "dip_width": model.dip_width,
        "straight": model.straight,
        "straight_width": model.straight_width,
        "noise2": model.noise**2,
        "chords": _padded(model.chords, MOST_CHORDS),
        "reaches": _padded(model.reaches, MOST_CHORDS),
        "chord_count": len(model.chords),
        "longest_reach": max(model.reaches),
    }


def _padded(values: ArrayLike, room: int) -> NDArray[Any]:
    """Return the values in an array of length `room`, padded with zeros."""
    given = np.asarray(values)
    padded = np.zeros(room, given.dtype)
    padded[: given.size] = given
    return padded


def _rate_bounds(model: StepSizeWeight) -> Record:
    return {
        "model": layout.RATE_BOUNDS,
        "signal": SIGNALS[model.channel],
        "least": model.least,
        "still": model.most,
    }


def _turn_resistance(model: TurnResistance) -> Record:
    weights = {"least": model.least, "still": model.most, "pace": model.pace}
    where = {"aligned2": model.aligned**2, "force2": LEAST_FORCE_N**2}
    return {"model": layout.TURN_RESISTANCE, **weights, **where}


def _no_contact_rise(model: NoContactRise) -> Record:
    heaviest = model.most_kg * GRAVITY
    return {
        "model": layout.NO_CONTACT_RISE,
        "scale2": model.scale**2,
        "reach": model.reach,
        "heaviest": heaviest,
    }


def _turn_in_place(model: TurnInPlace) -> Record:
    return {
        "model": layout.TURN_IN_PLACE,
        "joint": True,
        "pooled": AXES,
        "nu0": model.nu0,
        "floor2": model.floor**2,
        "scale2": model.share**2,
        "reach2": model.reach**2,
        "offset": 0.5 * model.nu0 * np.log(model.nu0),
    }


RECORDS: Mapping[type, Callable[[Any], Record]] = {
    ProfileModel: _profile_model,
    StudentRandomWalk: _random_walk,
    ConstantLevel: _constant_level,
    FreeSpaceForce: _free_space_force,
    LoadForce: _load_force,
    ContinuedLevel: _continued_level,
    ThesisLoadForce: _thesis_load_force,
    GripperHoldingChain: _gripper_holding,
    ContactMixture: _contact_mixture,
    ConstantVelocity: _constant_velocity,
    DissipativeContactWeight: _dissipative_contact,
    GuidedMotion: _guided_motion,
    TracedMotion: _traced_motion,
    CornerWeight: _corner_weight,
    TurnInPlace: _turn_in_place,
    StepSizeWeight: _rate_bounds,
    NoContactRise: _no_contact_rise,
    TurnResistance: _turn_resistance,
}
_NOISY = frozenset({ProfileModel, ConstantLevel, FreeSpaceForce, LoadForce, ContinuedLevel, ThesisLoadForce})
_WIDTHS: Mapping[type, int] = {
    ProfileModel: 10,
    StudentRandomWalk: 1,
    ConstantLevel: 9,
    FreeSpaceForce: 8,
    LoadForce: 8,
    ContinuedLevel: 17,
    ThesisLoadForce: 6,
    GripperHoldingChain: 2,
    ContactMixture: 2 + layout.STATES,
    ConstantVelocity: 12,
    DissipativeContactWeight: 1,
    GuidedMotion: 1 + MOST_SHARES,
    TracedMotion: 2 + MOST_SHARES + AXES,
    CornerWeight: MOST_CHORDS,
    TurnInPlace: 15,
    StepSizeWeight: 1,
    NoContactRise: 2,
    TurnResistance: 1,
}


def _noise(model: ChannelModel) -> Noise:
    noise = getattr(model, "noise", None)
    return noise if isinstance(noise, Noise) else Noise(1.0, 1.0)


def _width(model: ChannelModel) -> int:
    """Return the number of sums that a hypothesis keeps for one channel."""
    return _WIDTHS[type(model)]


def by_length(channel: Record, n: Ints) -> Floats:
    """Return (lengths,) the terms of log evidence, on one group of axes, that depend on n samples alone."""
    values = channel["pooled"] * np.maximum(n - channel["unvalued"], 0)
    nu0 = channel["nu0"] or 1.0
    gammas = gammaln(0.5 * (nu0 + values)) - gammaln(0.5 * nu0) - 0.5 * values * np.log(np.pi)
    whitened: Floats = channel["whitening"] * (n - channel["unwhitened"]) + channel["offset"]
    result: Floats = gammas + whitened
    return result
