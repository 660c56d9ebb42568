"""Every channel model with every option that matters, every preset's lattice, and what is true of each.

`DENSITY`: exp(evidence) over the next observation sums to the evidence before, so that it is the product of
predictives. The others are no densities, by design or by approximation; each says why, and what holds instead
is what test_channel_model_checks.py looks at.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any, get_args

import numpy as np

from caesura_service.changepoint.channel_model import Channel, ChannelModel, ModelInput, Noise, Origin, Rows
from caesura_service.changepoint.channel_model_checks import NOWHERE, rows_after
from caesura_service.changepoint.constant_models import (
    ConstantLevel,
    FreeSpaceForce,
    GripperHoldingChain,
    LoadForce,
    ThesisLoadForce,
)
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.contact_mixture import CONTACT, FREE, TRANSPORT, ContactMixture
from caesura_service.changepoint.continued_level import ContinuedLevel
from caesura_service.changepoint.corner_weight import CornerWeight
from caesura_service.changepoint.dissipative_contact import DissipativeContactWeight
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.force_rise_penalty import NoContactRise
from caesura_service.changepoint.guided_motion import GuidedMotion
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.profile_library import ProfileLibrary, first_order, minimum_jerk, overdamped
from caesura_service.changepoint.profile_model import DisplacementPrior, ProfileModel
from caesura_service.changepoint.random_walk import StudentRandomWalk
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.step_size_weight import StepSizeWeight
from caesura_service.changepoint.traced_motion import TracedMotion
from caesura_service.changepoint.turn_in_place import TurnInPlace
from caesura_service.changepoint.turn_resistance import TurnResistance

DENSITY = "a density"
APART = "a density of all samples together; of the next alone only where the noise is known for certain"
MIXED = "a mixture of a level and of itself given the observation before: `quadrature.continued`"
WEIGHTED = "a density times weights of at most 1, so that what should not be there is not overrated"
GIVEN_TARGET = (
    "the target is the last sample (3.27), which explains itself: a density of those before, given it"
)
PLUGGED_IN = "the thesis' mean is the data's own (3.52): the best of all loads, not their average"
LARGEST = "the thesis' maximum over profiles (3.39): the largest of densities, which sums to more than 1"


@dataclass(frozen=True)
class Entry:
    """A model, and what is true of it.

    unit: of the data, in the channel's; size: how far residuals go [unit]; `explains_first`: the first sample
    is the origin, and its evidence the same constant wherever it lies. unweighed: observations of a segment
    that get no weight.
    """

    model: ChannelModel
    holds: str
    channel: Channel = "position"
    unit: float = 1.0
    size: float = 0.5
    explains_first: bool = False
    unweighed: int = 0

    def observe(self, values: np.ndarray) -> list[ModelInput]:
        """Observations of values (n, 3) [unit] in the model's channel."""
        return [NOWHERE._replace(**{self.channel: value}) for value in self.unit * values]


@dataclass(frozen=True)
class Whole:
    """A lattice as if it were one model; its rows are those of all channels in a row."""

    lattice: SegmentModelSet

    def _divided(self, rows: Rows) -> tuple[Rows, ...]:
        rest = iter(rows)
        return tuple(tuple(next(rest) for _ in part) for part in self.lattice.empty())

    def empty(self) -> Rows:
        return sum(self.lattice.empty(), ())

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        return sum(self.lattice.extend(self._divided(rows), observed), ())

    def log_evidence(self, rows: Rows) -> np.ndarray:
        return log_sum_exp(self.lattice.combine(self.lattice.kind_log_evidence(self._divided(rows))))


ORIGINS: tuple[Origin, ...] = get_args(Origin)
LIBRARIES = {
    "overdamped": (overdamped(8.0, 32.5), overdamped(24.0, 10.0)),
    "minimum jerk": (minimum_jerk(0.25), minimum_jerk(0.8)),
    "rise": (first_order(2.0), first_order(12.0)),
}
CERTAIN = 1e5  # nu0 of a noise whose variance is known
SHARES = (0.05, 0.3)


def library(name: str, correlation: float = 0.0, rest_scale_ratio: float = 1.0) -> ProfileLibrary:
    return ProfileLibrary(LIBRARIES[name], 0.1, correlation, rest_scale_ratio)


def _constants() -> Iterator[tuple[str, Entry]]:
    channels = cycle(get_args(Channel))
    for origin in ORIGINS:
        for correlation, joint in ((0.0, False), (0.0, True), (0.6, True)):
            channel, noise = next(channels), Noise(4.0, 0.5, joint=joint, correlation=correlation)
            name = f"constant {channel}, {origin}, ρ = {correlation}{', joint' * joint}"
            model = ConstantLevel(channel, noise, origin)
            yield name, Entry(model, DENSITY, channel, explains_first=origin == "first")


def _free_space() -> Iterator[tuple[str, Entry]]:
    for correlation, joint in ((0.0, False), (0.6, True)):
        noise = Noise(4.0, 0.5, joint=joint, correlation=correlation)
        name = f"ρ = {correlation}{', joint' * joint}"
        yield f"biased, {name}", Entry(FreeSpaceForce(noise, 1.5), APART, "force")
        yield (
            f"biased, {name}, noise known",
            Entry(FreeSpaceForce(replace(noise, nu0=CERTAIN), 1.5), DENSITY, "force"),
        )
        yield f"biased, {name}, absence", Entry(FreeSpaceForce(noise, 1.5, absence=3.0), WEIGHTED, "force")
        light = FreeSpaceForce(noise, 1.5, absence=3.0, most_kg=0.1)
        yield f"biased, {name}, absence but for a weight", Entry(light, WEIGHTED, "force")
        yield f"laden, {name}", Entry(LoadForce(noise, 1.5), APART, "force")
        yield f"laden, {name}, absence", Entry(LoadForce(noise, 1.5, absence=3.0), WEIGHTED, "force")
        for level in (FreeSpaceForce(noise, 1.5, absence=3.0, most_kg=0.1), LoadForce(noise, 1.5)):
            mixture = ContinuedLevel(level, 0.3, memory=1)
            yield f"continued {type(level).__name__}, {name}", Entry(mixture, MIXED, "force")
        known = ContinuedLevel(FreeSpaceForce(replace(noise, nu0=CERTAIN), 1.5), 0.5, memory=1)
        yield f"continued, {name}, noise known", Entry(known, DENSITY, "force")


def _profiled() -> Iterator[tuple[str, Entry]]:
    noise = Noise(4.0, 0.5)
    human = replace(noise, shares=SHARES, joint=True, correlation=0.6)
    target = DisplacementPrior(reach=4.0, least=0.5)

    def entry(moves: str, noise: Noise, holds: str = GIVEN_TARGET, **options: Any) -> Entry:
        channel: Channel = options.pop("channel", "force" if moves == "rise" else "position")
        rest_scale_ratio = options.pop("rest_scale_ratio", 1.0)
        model = ProfileModel(channel, library(moves, noise.correlation, rest_scale_ratio), noise, **options)
        return Entry(model, holds, channel, explains_first=model.origin == "first")

    for moves, origin in zip(LIBRARIES, ORIGINS, strict=True):
        yield f"{moves}, maximum", entry(moves, noise, LARGEST, choice="maximum")
        yield f"{moves}, {origin}", entry(moves, noise, origin=origin)
    for moves, origin in zip(reversed(LIBRARIES), ORIGINS, strict=True):
        yield f"{moves}, {origin}, human, target", entry(moves, human, origin=origin, target=target)
    for varied in (noise, replace(noise, correlation=0.6, joint=True)):
        name = f"minimum jerk, ρ = {varied.correlation}"
        yield name, entry("minimum jerk", varied, origin="previous")
        yield f"{name}, target", entry("minimum jerk", varied, origin="previous", target=target)
    shared = replace(noise, shares=SHARES)
    yield "minimum jerk, shares", entry("minimum jerk", shared, origin="previous", target=target)
    release = {"channel": "force", "origin": "previous", "target": target}
    yield "force along minimum jerk", entry("minimum jerk", human, **release)
    yield "rise or release", entry("rise", human, **release)
    yield (
        "minimum jerk, pace",
        entry("minimum jerk", human, WEIGHTED, origin="previous", target=target, pace=0.5),
    )
    yield (
        "minimum jerk, calm",
        entry("minimum jerk", human, origin="previous", target=target, rest_scale_ratio=0.3),
    )


def _walks() -> Iterator[tuple[str, Entry]]:
    walk = StudentRandomWalk("force", 0.5, nu=3.0)
    yield "walk", Entry(walk, DENSITY, "force")
    yield "walk, still", Entry(replace(walk, channel="position", still=1.0), WEIGHTED)
    yield "walk, presence", Entry(replace(walk, presence=2.0), WEIGHTED, "force")


def _guided() -> Iterator[tuple[str, Entry]]:
    model = GuidedMotion(0.8, floor=0.2, share=0.3, burst=0.4, nu=4.0)
    yield "guided motion", Entry(model, DENSITY)
    one = replace(model, scales=(1.0,), burst_steps=1, floor=0.8)
    yield "guided motion, one scale", Entry(one, DENSITY, size=0.8)
    yield "guided motion, pace", Entry(replace(model, pace=0.5), WEIGHTED)
    yield "guided motion, away", Entry(replace(model, away=1.0), WEIGHTED, unweighed=3)


def _traced() -> Iterator[tuple[str, Entry]]:
    model = TracedMotion(floor=0.4, speed=1.0, discount=0.9)
    yield "traced motion", Entry(model, DENSITY)
    yield "traced motion, one scale", Entry(replace(model, scales=(1.0,), discount=1.0), DENSITY, size=0.8)
    yield "traced motion, away", Entry(replace(model, away=1.0), WEIGHTED, unweighed=3)


def _preset_channels() -> Iterator[tuple[str, ChannelModel]]:
    for preset in PRESETS.values():
        for name, model in preset.channels(1.5).items():
            yield f"{preset.name}: {name}", model


_TWO_LEVELS = SegmentModelSet(
    {
        "low": ConstantLevel("force", Noise(4.0, 0.5, joint=True), "zero"),
        "high": ConstantLevel("force", Noise(4.0, 2.0, joint=True), "zero"),
    },
    (
        SegmentKind("motion", "motion", "free", ("low",), 3.0),
        SegmentKind("steady", "steady", "free", ("high",), 1.0),
    ),
)

MODELS: dict[str, Entry] = {
    "constant velocity": Entry(
        ConstantVelocity(nu0=4.0, sigma2=0.5, kappa0=1.0, length_unit_m=0.01, step_s=0.1),
        DENSITY,
        unit=0.01,
        explains_first=True,
    ),
    **dict(_constants()),
    **dict(_free_space()),
    **dict(_profiled()),
    **dict(_walks()),
    **dict(_guided()),
    **dict(_traced()),
    **{
        f"contact, state {state}": Entry(ContactMixture(state, contact2=1.5), DENSITY, "force")
        for state in (FREE, CONTACT, TRANSPORT)
    },
    "carried": Entry(ThesisLoadForce(Noise(4.0, 0.5), least_kg=0.2), PLUGGED_IN, "force"),
    "a mixture of two kinds": Entry(Whole(_TWO_LEVELS), DENSITY, "force"),
}

# What has no value in space, or is a preset's: the properties that need no density.
EVERYTHING: dict[str, ChannelModel] = {
    **{name: entry.model for name, entry in MODELS.items()},
    "held": GripperHoldingChain(0.2, change=0.1),
    "dissipation": DissipativeContactWeight(least=2.0, pace=0.002),
    "corner": CornerWeight(gamma=30.0, pace=0.0005),
    "corner, standing": CornerWeight(gamma=30.0, pace=0.0005, standing=10.0, fast=0.004),
    "corner, straight": CornerWeight(gamma=30.0, pace=0.0005, straight=0.8),
    "corner of a turn": CornerWeight(gamma=30.0, pace=0.005, channel="rotation"),
    "no rise": NoContactRise(scale=1.0),
    "no rise but a weight's": NoContactRise(scale=1.0, most_kg=0.1),
    "pace": StepSizeWeight("rotation", least=0.02, most=0.1),
    "resistance": TurnResistance(least=0.2, aligned=0.5),
    "no resistance": TurnResistance(most=0.2),
    "pivot": TurnInPlace(floor=0.001, share=0.02, reach=0.1),
    "pivot of a known scale": TurnInPlace(floor=0.0002, share=0.002, reach=0.3, nu0=1000.0),
    **dict(_preset_channels()),
    **{f"{name}'s lattice": Whole(preset.lattice()) for name, preset in PRESETS.items()},
    "default's lattice with an orientation": Whole(PRESETS["default"].lattice(orientation=True)),
    "default's lattice with a torque": Whole(PRESETS["default"].lattice(orientation=True, torque=True)),
}


def observations(count: int, seed: int = 0) -> list[ModelInput]:
    """Something of everything: a movement, a force, a gripper that is known now and then."""
    rng = np.random.default_rng(seed)
    position = np.array([0.4, -0.3, 0.2]) + np.cumsum(rng.normal(0, 0.01, (count, 3)), axis=0)
    force = rng.normal([0.5, 0.0, -3.0], 1.0, (count, 3))
    holding = np.resize([np.nan, 0.0, 0.0, 1.0, np.nan], count)
    rotation = np.cumsum(rng.normal(0, 0.05, (count, 3)), axis=0)
    torsion = 0.1 * rng.normal(size=(count, 1)) * force
    return [
        ModelInput(*one) for one in zip(position, force, holding.tolist(), rotation, torsion, strict=True)
    ]


def digest() -> str:
    """Of all that every model says, bit for bit."""
    weighed = hashlib.sha256()
    for model in EVERYTHING.values():
        weighed.update(model.log_evidence(rows_after(model, observations(12))).tobytes())
    return weighed.hexdigest()


if __name__ == "__main__":
    print(digest())
