"""Long results: valid ones, and such with costly content in every place, at any depth."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import msgpack

from caesura_protocol.codec import encode
from caesura_protocol.messages import (
    App,
    AppPath,
    Changepoint,
    Changepoints,
    Hints,
    Message,
    Posterior,
    Program,
    Segments,
    Snapshot,
    ViaPoint,
)
from harness.heavy import FILLINGS, array_of, distinct_keys, places_in, text_of, with_value

VECTORS = Path(__file__).parents[1] / "vectors"
SHORT_RESULTS: tuple[type[Message], ...] = (Posterior, Hints)
LONG_RESULTS: tuple[type[Message], ...] = (Changepoints, Segments, Program, Snapshot)
HOSTILE_BYTES = 60_000
V = (0.1, 0.2, 0.3)
POSE = ViaPoint(t=1.1, position=V, orientation=(*V, 0.4), velocity=V, angular_velocity=V)
WAY = {"tn": 2.5, "end_velocity": V, "end_angular_velocity": V, "length_m": 0.1}
WAY |= dict.fromkeys(("deviation_m", "deviation_rad", "tolerance_m", "tolerance_rad"), 0.1)
PROGRAM = {"station": "cell-1", "session": "s1", "instance": "caesura-0", "epoch": 1, "version": 1, "t": 0.0}
NONE = dict.fromkeys(
    ["target", "orientation", "joints", "force", "force_taught", "load_kg", "load_sd_kg", "gripper_width"],
    None,
)
BARE_APP = App(kind="hold", t0=0.1, tn=1.5, confidence=0.5, segments=(), **NONE)


def program_of(apps: tuple[App, ...]) -> Program:
    return Program(**PROGRAM, complete=True, apps=apps, notes=("",))


def sound_result(model: type[Message]) -> bytes:
    """A valid message of that type, of about HOSTILE_BYTES."""
    one = Changepoint(t=1.5, probability=0.5, certainty="final", t_low=1.0, t_high=2.0)
    apps = (BARE_APP.model_copy(update={"path": AppPath(start=POSE, via=(POSE,) * 8, **WAY)}),)
    tree = msgpack.unpackb((VECTORS / f"{model.__name__}.msgpack").read_bytes())
    long = {"changepoints": [one.model_dump()], "segments": tree.get("segments")}
    match model.__name__:
        case "Snapshot":
            tree["program"] = msgpack.unpackb(encode(program_of(apps * 100)).payload)
        case "Program":
            tree = msgpack.unpackb(encode(program_of(apps * 100)).payload)
        case name:
            (field,) = long.keys() & tree.keys()
            size = len(msgpack.packb(long[field]))
            tree[field] = long[field] * max(1, HOSTILE_BYTES // size)
            assert name in {"Changepoints", "Segments"}
    return msgpack.packb(tree)


def hostile_results(model: type[Message], size: int) -> Iterator[tuple[str, bytes]]:
    """(what it is, payload) with costly content in every place of a valid result, at any depth."""
    tree = msgpack.unpackb((VECTORS / f"{model.__name__}.msgpack").read_bytes()) | {"unheard-of": 0}
    names = ("numbers", "floats", "short texts", "arrays of 64", "arrays of 64 maps")
    values = {name: array_of(FILLINGS[name], size) for name in names}
    values |= {"distinct keys": distinct_keys(size), "a text": text_of(size)}
    for place, (what, value) in product(places_in(tree), values.items()):
        yield f"{place}: {what}", with_value(tree, place, value)
