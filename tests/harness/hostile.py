"""Whatever a hostile peer may send, and a service to send it to; all of it from one random generator."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from caesura_protocol.codec import (
    MESSAGE_TYPES,
    Encoded,
    decode,
    decode_error,
    encode,
    encode_error,
    encoding_of,
    unpack_samples,
)
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import ReplayRange, parse_replay_parameters, parse_station_key, replay_parameters
from caesura_protocol.messages import Close, Control, Heartbeat, Open, SampleBatch
from caesura_service.journal import MemoryJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import (
    Output,
    Owner,
    PipelineFactory,
    Publish,
    ReplayEnded,
    Reply,
    RequestReplay,
    SessionFailed,
)
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline

VECTORS = Path(__file__).resolve().parents[1] / "vectors"
GOLDEN = [(path.read_bytes(), path.stem.partition(".")[0]) for path in sorted(VECTORS.glob("*.msgpack"))]
VICTIM = "victim"  # a station that nobody attacks
STATIONS = ("cell-1", "cell-2", "cell-3")
SESSIONS = ("s1", "s2", "s3")
COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")
FLOATS = (0.0, -0.0, 1.0, 1e-320, 1e-9, 9e5, -9e5, 1e9, 1e300, -1e300, math.inf, -math.inf, math.nan)
COUNTS = (
    0,
    1,
    2,
    3,
    5,
    127,
    128,
    129,
    1000,
    1_000_000,
    1 << 31,
    (1 << 53) - 1,
    1 << 53,
    1 << 64,
    -1,
    -(1 << 63),
)
NAMES = ("s1", "s2", "", "A", "a/b", "*", "..", "s" * 65, "ä", "s1\x00", "caesura")
FAST_S = 0.01  # between two samples of a batch that is well-formed


class Crash(Exception):  # noqa: N818
    """What must not happen: anything but a ProtocolError, or a session that was ended by an error of ours."""


class Hostile:
    """Makes payloads."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.session, self.next_seq, self.epoch = SESSIONS[0], 0, 0  # whom to send what is expected

    def payload(self) -> Encoded:
        """Golden and then mutated, random bytes, a random tree, or well-formed with hostile values."""
        rng = self.rng
        make: Callable[[], bytes | Encoded] = rng.choices(
            (self._mutated, self._noise, self._tree, self.message), (4, 1, 2, 6)
        )[0]
        made = make()
        if isinstance(made, Encoded):
            return made
        return Encoded(made, self._encoding(rng.choice(list(MESSAGE_TYPES))))

    def message(self) -> Encoded:
        """Well-formed but for its values."""
        kind = self.rng.choices(("SampleBatch", "Heartbeat", "Control"), (6, 1, 2))[0]
        fields = {"SampleBatch": self._batch, "Heartbeat": self._beat, "Control": self._control}[kind]()
        return Encoded(msgpack.packb(fields), self._encoding(kind))

    def ended(self) -> ReplayEnded:
        """The end of an answer to a replay."""
        rng = self.rng
        oldest = rng.choice((None, *COUNTS))
        answered, evicted = rng.random() < 0.5, rng.random() < 0.3
        return ReplayEnded(rng.choice(SESSIONS), rng.choice(COUNTS), answered, evicted, oldest)

    def _encoding(self, name: str) -> str:
        if self.rng.random() < 0.95:
            return encoding_of(MESSAGE_TYPES[name])
        return self.rng.choice(
            (
                "",
                "text/plain",
                f"application/msgpack;caesura.{name}.v2",
                "application/msgpack;caesura..v1",
                "\x00",
            )
        )

    def _mutated(self) -> bytes | Encoded:
        golden, name = self.rng.choice(GOLDEN)
        data = bytearray(golden)
        for _ in range(self.rng.randint(0, 4)):
            at, to = sorted(self.rng.randrange(len(data) + 1) for _ in range(2))
            self.rng.choice(
                (
                    lambda at=at: data.__setitem__(slice(at, at + 1), bytes([self.rng.randrange(256)])),
                    lambda at=at, to=to: data.__delitem__(slice(at, to)),
                    lambda at=at, to=to: data.__setitem__(slice(to, to), data[at:to]),
                    lambda at=at: data.__delitem__(slice(at, None)),
                )
            )()
        return Encoded(bytes(data), self._encoding(name))

    def _noise(self) -> bytes:
        return self.rng.randbytes(self.rng.choice((0, 1, 3, 20, 300, 3000)))

    def _tree(self) -> bytes:
        return bytes(msgpack.packb(self._value(4)))

    def _value(self, depth: int) -> Any:
        rng = self.rng
        kind = rng.randrange(8 if depth else 6)
        if kind >= 6:
            items = [self._value(depth - 1) for _ in range(rng.randint(0, 4))]
            return items if kind == 6 else {rng.choice((*NAMES, 1, None)): item for item in items}
        whole = rng.choice([count for count in COUNTS if -(1 << 63) <= count < 1 << 64])
        return (None, rng.random() < 0.5, whole, rng.choice(FLOATS), rng.choice(NAMES), rng.randbytes(9))[
            kind
        ]

    def _header(self) -> dict[str, Any]:
        session = self.rng.choices(
            (self.session, self.rng.choice(SESSIONS), self.rng.choice(NAMES)), (20, 2, 1)
        )[0]
        epoch = self.rng.choices((self.epoch, self.epoch + 1, self._count()), (40, 1, 1))[0]
        return {"session": session, "epoch": epoch}

    def _count(self) -> Any:
        return self.rng.choice([count for count in COUNTS if -(1 << 63) <= count < 1 << 64])

    def _beat(self) -> dict[str, Any]:
        return {**self._header(), "seq": self._count()}

    def _control(self) -> dict[str, Any]:
        if self.rng.random() < 0.3:
            last_seq = self.rng.choice((self.next_seq - 1, self.next_seq + 2, self._count()))
            name = self._header()["session"]
            return {"command": {"type": "close", "session": name, "last_seq": last_seq}}
        columns = self.rng.choice(
            (COLUMNS, COLUMNS, COLUMNS, ("t", "px"), ("t",), ("px", "t"), ("t",) * 9, ("t", "x" * 999))
        )
        sources = ("flange_sensor", "none", "joint_torque_estimate", "flange_sensor_with_hand", "magic", None)
        presets = (None, None, None, "fake", "default", "integrated", "unknown", "../../etc/passwd")
        return {
            "command": {
                "type": "open",
                **self._header(),
                "columns": columns,
                "wrench_source": self.rng.choices(sources, (8, 1, 1, 1, 1, 1))[0],
                "hand_on_robot": self.rng.choice(("yes", "yes", "unknown", "no", 7)),
                "force_frame": self.rng.choice(("base", "base", "flange", 3)),
                "length_unit": self.rng.choice(("m", "m", "mm", "cm", "mile")),
                "preset": self.rng.choice(presets),
            }
        }

    def _batch(self) -> dict[str, Any]:
        rng = self.rng
        rows, columns = (
            rng.choice((1, 2, 20, 20, 20, 1000)),
            rng.choice((COLUMNS, COLUMNS, COLUMNS, ("t", "px"))),
        )
        seq = rng.choices((self.next_seq, self.next_seq + rng.randint(-2, 9), self._count()), (12, 3, 1))[0]
        matrix = np.full((rows, len(columns)), 0.1)
        matrix[:, 0] = FAST_S * np.arange(rows)
        t0 = rng.choices((FAST_S * 20 * seq if 0 <= seq < 1000 else 0.0, rng.choice(FLOATS)), (8, 1))[0]
        for _ in range(rng.choice((0, 0, 0, 1, 5))):
            matrix[rng.randrange(rows), rng.randrange(len(columns))] = rng.choice(FLOATS)
        with np.errstate(over="ignore"):
            samples = matrix.astype(rng.choice(("<f8", "<f4"))).tobytes()
        n = rows if rng.random() < 0.95 else self._count()
        samples = samples if rng.random() < 0.95 else samples[: rng.randrange(len(samples) + 1)]
        return {**self._header(), "seq": seq, "n": n, "columns": columns, "t0": t0, "samples": samples}


class Target:
    """A registry that is sent hostile things as the worker sends them, and a victim that must not notice."""

    def __init__(self, pipelines: PipelineFactory = make_fake_pipeline, preset: str = "fake") -> None:
        self.registry = Registry(
            owner=Owner("test-1", 1),
            pipeline_factory=pipelines,
            default_preset=preset,
            journal=MemoryJournal(),
            limits=Limits(),
        )
        self.inputs = 0
        opening = Open(session="mine", columns=COLUMNS, wrench_source="flange_sensor")
        self._check(self.registry.handle_command(VICTIM, opening, 0.0))
        for station in STATIONS:
            for session in SESSIONS:
                self._check(
                    self.registry.handle_command(
                        station, Open(session=session, columns=COLUMNS, wrench_source="flange_sensor"), 0.0
                    )
                )
        self._before = self._victim()

    def attack(self, hostile: Hostile) -> None:
        """One input of any kind. Raises Crash."""
        self.inputs += 1
        rng, now = hostile.rng, 0.1 * self.inputs
        station = rng.choice(STATIONS)
        self._aim(hostile, station)
        try:
            what = rng.choices(("samples", "control", "ended", "tick"), (12, 3, 1, 1))[0]
            if what == "ended":
                self._check(self.registry.handle_samples(station, hostile.ended(), now))
            elif what == "tick":
                self._check(self.registry.tick(now))
            else:
                self._take(station, what, hostile.payload(), now)
        except ProtocolError as error:
            raise Crash(f"{what} raised out of the registry: {error}") from error
        if self._victim() != self._before:
            raise Crash("a session of another station has changed")

    def _aim(self, hostile: Hostile, station: str) -> None:
        """Most of what is sent goes to a session that takes it: only then does it get far."""
        sessions = self.registry.index.sessions.get(station, ())
        living = [session for session in sessions if session.is_open]
        if living:
            session = hostile.rng.choice(living)
            hostile.session, hostile.next_seq = session.name, session.next_seq
            hostile.epoch = session._opening.epoch

    def _take(self, station: str, what: str, content: Encoded, now: float) -> None:
        expected = (Control,) if what == "control" else (SampleBatch, Heartbeat)
        try:
            message = decode(*content, *expected)
        except ProtocolError as error:
            encode_error(error)
            self._check(self.registry.reject(station, error))
            return
        if isinstance(message, Control):
            self._check(self.registry.handle_command(station, message.command, now))
        else:
            self._check(self.registry.handle_samples(station, message, now))

    def _check(self, outputs: list[Output]) -> None:
        """What the edge does with it."""
        for output in outputs:
            match output:
                case Publish(message):
                    encode(message)
                case RequestReplay(_, _, first, last):
                    wanted = ReplayRange(first, last, last - first + 1)
                    parse_replay_parameters(replay_parameters(wanted))
                case Reply(ProtocolError() as refusal):
                    encode_error(refusal)
                case Reply(ack):
                    encode(ack)
                case SessionFailed(error=error):
                    raise Crash(f"a session was ended by {type(error).__name__}: {error}") from error

    def _victim(self) -> Any:
        (standing,) = [one for one in self.registry.index.all_states() if one.station == VICTIM]
        return standing


def read_everything(content: Encoded) -> None:
    """The codec on a payload, as every type. Raises whatever is no ProtocolError."""
    for read in readers(content):
        try:
            message = read()
            if isinstance(message, SampleBatch):
                unpack_samples(message)
        except ProtocolError as error:
            decode_error(*encode_error(error))


def readers(content: Encoded) -> Iterator[Callable[[], Any]]:
    yield lambda: decode(content.payload, content.encoding, *MESSAGE_TYPES.values())
    for model in (SampleBatch, Control, Close):
        yield lambda model=model: decode(content.payload, encoding_of(model), model)
    yield lambda: decode_error(*content)
    yield lambda: parse_station_key(content.payload[:80].decode("latin-1"))
    yield lambda: parse_replay_parameters(content.payload[:80].decode("latin-1"))
