"""The source `ros2`: decodes live ROS 2 topics over Zenoh and joins them to rows. Needs the extra `ros2`.

Two layouts of keys, distinguished by their form:
  rmw_zenoh          <domain>/<topic>/<pkg>::msg::dds_::<Type>_/<hash>, payload CDR, an attachment of 33 bytes
                     (number, time, gid) that is not needed: times are those of the headers;
  zenoh-bridge-ros2dds  [<namespace>/]<topic>, payload CDR; the key does not contain the type, a mapping must.
Without a mapping, every topic of a supported type is read; only keys of rmw_zenoh contain the type.

Decoding a FrankaRobotState takes 0.1 ms, so it is done in the bridge, and the service receives batches.
"""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from caesura_clients.bridge.sources import Chunk, Mark
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.ros_messages import TopicRule, definitions_of, stamp_of, topic_rules
from caesura_protocol.formats.ros_types import FRANKA_STATE, READ, CannotDecode, decoder
from caesura_protocol.formats.signal_aligner import Row, SignalAligner
from caesura_protocol.formats.topic_selection import (
    Topic,
    TopicSelection,
    select_topics,
    with_arm_joints,
)
from caesura_protocol.formats.unvalidated_recording import UserStatements
from caesura_protocol.messages import ForceFrame, HandOnRobot, LengthUnit, WrenchSource
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.programs.safety import UNSET, CellSettings
from caesura_protocol.recording import RecordingError
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_protocol.up_direction import parse_up

CHUNK_SAMPLES = 20
PATIENCE_S = 0.1  # that a row waits for a topic that lags behind
LISTEN_S = 0.5  # to what is there, from the first message on, where no mapping says what to wait for
DISCOVER_S = 10.0  # until no publisher has appeared
CONNECT_S = 10.0
TICK_S = 0.05
INBOX = 16_384
NAMED_STRETCHES = 3  # in which messages were lost, the newest
GUIDING = 3  # `FrankaRobotState.ROBOT_MODE_GUIDING` (franka_msgs 1.0.0)
_DDS_TYPE = re.compile(r"(?P<package>\w+)::msg::dds_::(?P<name>\w+)_")


class ReceivedMessage(NamedTuple):
    """A decoded message and its topic; the message is None for a mark."""

    topic: Topic
    message: Any


class LostStretches:
    """Intervals [s] of the session in which messages were dropped.

    Each is from the row before to the row after.
    """

    def __init__(self) -> None:
        self.count = 0
        self._newest: deque[tuple[float, float]] = deque(maxlen=NAMED_STRETCHES)
        self._dropped = 0
        self._begins_s: float | None = None

    def look(self, dropped: int, before_s: float, after_s: float | None) -> None:
        """Record an interval if the count of dropped messages has risen. Called for each message.

        dropped: total count; before_s: time of the newest row before the message; after_s: time of the row
        that the message completed, None if it completed none.
        """
        if self._begins_s is not None and after_s is not None:
            self._add(self._begins_s, after_s)
            self._begins_s = None
        if dropped > self._dropped:  # they may have followed this message: the next row is behind them
            self._dropped = dropped
            self._begins_s = before_s if self._begins_s is None else self._begins_s

    def _add(self, begins_s: float, ends_s: float) -> None:
        if self._newest and begins_s <= self._newest[-1][1]:
            begins_s = self._newest.pop()[0]
        else:
            self.count += 1
        self._newest.append((begins_s, ends_s))

    def __str__(self) -> str:
        at_end = [] if self._begins_s is None else [f"from {fixed(self._begins_s, 2)} s on"]
        times = [f"{interval(first, last, 2)} s" for first, last in self._newest]
        return ", ".join([*(["…"] if self.count > len(times) else []), *times, *at_end])


class Ros2Source:
    """ROS 2 topics as a Source.

    It subscribes in the constructor, because its columns follow from the topics found. over: ends `chunks`
    from another thread, after the rows received so far. Raises SourceError if nothing is received in
    `discover_s`, a payload cannot be decoded or a topic lacks a needed signal.
    """

    length_unit: LengthUnit = "m"
    can_wait = False

    def __init__(
        self,
        transport: Transport,
        mapped: ColumnMapping | None = None,
        *,
        wrench_source: str | None = None,
        force_frame: str | None = None,
        hand_on_robot: str | None = None,
        robot: str | None = None,
        definitions: list[tuple[str, str]] | None = None,
        discover_s: float = DISCOVER_S,
        over: threading.Event | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._rules = topic_rules(mapped)
        self._decoder = decoder(definitions or [])
        self._domain = str(mapped.table.get("domain", "*")) if mapped is not None else "*"
        self._over = over or threading.Event()
        self._clock = clock
        self._inbox = Inbox(INBOX)
        self._lost = LostStretches()
        self._stack = ExitStack()
        try:
            for key in self._keys():
                self._stack.enter_context(transport.subscribe(key, self._inbox))
            self._first_messages = self._discover(discover_s)
            self._plan = self._selection(mapped, UserStatements(wrench_source, force_frame, robot))
        except BaseException:
            self._stack.close()
            raise
        self._aligner = SignalAligner(self._plan.signals, patience_s=PATIENCE_S, joints=self._plan.joints)
        self.columns = self._aligner.columns
        self.wrench_source = cast(WrenchSource, self._plan.options["wrench_source"])
        stated = hand_on_robot or self._plan.options.get("hand_on_robot", "unknown")
        self.hand_on_robot = cast(HandOnRobot, stated)
        up = self._plan.options.get("up")
        self.setting = UNSET if up is None else CellSettings(up=parse_up(up))
        self.force_frame = cast(ForceFrame, self._plan.options.get("force_frame", "base"))
        has_mode = any(one.topic.type == FRANKA_STATE for one in self._first_messages)
        self.button_pressed: bool | None = False if has_mode else None  # as of the newest chunk

    @property
    def dropped(self) -> int:
        """Return how many messages were dropped because the inbox was full."""
        return self._inbox.dropped

    @property
    def lost_words(self) -> str:
        """Return the intervals of dropped messages as text, to follow their number.

        Empty if none was dropped.
        """
        return f": samples are missing at {self._lost}" if self.dropped else ""

    def close_with(self, close: Callable[[], None]) -> None:
        """Call `close` after everything else is closed."""
        topics = self._stack.pop_all()
        self._stack.callback(close)
        self._stack.push(topics)

    def close(self) -> None:
        """Close the subscriptions."""
        self._over.set()
        self._stack.close()

    def chunks(self) -> Iterator[Chunk | Mark]:
        """Yield rows once they are complete, first those received during the discovery."""
        try:
            rows: list[Row] = []
            for received in self._received_messages():
                if received is not None and received.topic.rule.mark:
                    yield Mark(self._aligner.latest_s)
                elif received is not None:
                    rows += self._aligned_rows(received)
                if rows and (received is None or len(rows) >= CHUNK_SAMPLES):
                    yield np.array(rows)
                    rows = []
            rows += self._aligner.flush()
            if rows:
                yield np.array(rows)
        finally:
            self.close()

    def _aligned_rows(self, received: ReceivedMessage) -> list[Row]:
        if received.topic.type == FRANKA_STATE:
            self.button_pressed = received.message.robot_mode == GUIDING
        before_s = self._aligner.latest_s
        with _as_source():
            stamp = stamp_of(received.message, received.topic.name)
            rows = self._aligner.push(stamp, self._plan.select_values(received.topic, received.message))
        if not self._first_messages:  # those were received before anything was dropped
            self._lost.look(self.dropped, before_s, rows[-1][0] if rows else None)
        return rows

    def _received_messages(self) -> Iterator[ReceivedMessage | None]:
        """Yield every message, first those of the discovery; None if none was received for a moment."""
        yield from self._first_messages
        self._first_messages = []
        while True:
            item = self._inbox.get(TICK_S)
            if isinstance(item, ReceivedSample):
                received = self._decode_message(item)
                if received is not None:
                    yield received
            else:
                if self._over.is_set():
                    return
                yield None

    # --- what there is ----------------------------------------------------------------------------------

    def _keys(self) -> list[str]:
        if not self._rules:
            return [f"{self._domain}/**/{_dds(name)}/*" for name in READ]
        return [key for name in self._rules for key in (f"{self._domain}{_path(name)}/*/*", _path(name)[1:])]

    def _decode_message(self, delivery: ReceivedSample) -> ReceivedMessage | None:
        """Return the decoded message; None for a topic that is not read. Raises SourceError."""
        found = parse_key(delivery.key)
        rule = self._rules.get(found.topic, TopicRule(found.topic))
        if rule.mark:
            return ReceivedMessage(Topic(found.topic, found.type or "", rule), None)
        kind = found.type or rule.type
        if kind is None:
            raise SourceError(
                f"{found.topic}: its key does not contain its type: state it in a mapping, for example "
                f'[topics."{found.topic}"] with type = "{READ[0]}"'
            )
        if kind not in READ:
            return None
        try:
            message = self._decoder.read(kind, delivery.payload, found.hash)
        except CannotDecode as error:
            raise SourceError(f"{found.topic}: {error}") from error
        return ReceivedMessage(Topic(found.topic, kind, rule), message)

    def _discover(self, discover_s: float) -> list[ReceivedMessage]:
        """Receive until every mapped topic has a message; for LISTEN_S without a mapping."""
        received: list[ReceivedMessage] = []
        missing_topics = {name for name, rule in self._rules.items() if not rule.mark}
        deadline = self._clock() + discover_s
        while self._clock() < deadline:
            item = self._inbox.get(TICK_S)
            one = self._decode_message(item) if isinstance(item, ReceivedSample) else None
            if one is None:
                continue
            if not received and not self._rules:
                deadline = min(deadline, self._clock() + LISTEN_S)
            received.append(one)
            missing_topics.discard(one.topic.name)
            if self._rules and not missing_topics:
                return received
        if missing_topics or not received:
            there = ", ".join(sorted({one.topic.name for one in received})) or "nothing"
            raise SourceError(
                f"ros2: no message of {', '.join(sorted(missing_topics)) or ' or '.join(READ)} within "
                f"{discover_s:g} s; received {there}, listening to {', '.join(self._keys())}"
            )
        return received

    def _selection(self, mapped: ColumnMapping | None, stated: UserStatements) -> TopicSelection:
        with _as_source():
            pairs = [(one.topic, one.message) for one in self._first_messages if not one.topic.rule.mark]
            pairs = with_arm_joints(pairs, mapped, stated)
            self._rules |= {topic.name: topic.rule for topic, _ in pairs}
            self._first_messages = [self._with_rule(one) for one in self._first_messages]
            return select_topics(pairs, mapped, stated)

    def _with_rule(self, received: ReceivedMessage) -> ReceivedMessage:
        topic = received.topic
        return received._replace(topic=topic._replace(rule=self._rules.get(topic.name, topic.rule)))


def open_ros2(
    endpoint: str,
    config: Path | None,
    mapped: ColumnMapping | None,
    mapping: Path | None,
    wrench_source: str | None,
    hand_on_robot: str | None = None,
    force_frame: str | None = None,
    robot: str | None = None,
) -> Ros2Source:
    """Open a source with its own connection to the ROS 2 router. Raises SourceError, Unreachable."""
    with _as_source():
        definitions = definitions_of(topic_rules(mapped), mapping)
    transport = ZenohTransport(endpoint, config_file=config, timeout_s=CONNECT_S)
    try:
        source = Ros2Source(
            transport,
            mapped,
            wrench_source=wrench_source,
            force_frame=force_frame,
            hand_on_robot=hand_on_robot,
            robot=robot,
            definitions=definitions,
        )
    except BaseException:
        transport.close()
        raise
    source.close_with(transport.close)
    return source


class TopicKey(NamedTuple):
    """The topic, type and hash in a key."""

    topic: str
    type: str | None  # None where the key does not contain it
    hash: str | None


def parse_key(key: str) -> TopicKey:
    """Return the topic, type and hash of a key, in either layout.

    >>> parse_key("0/ft/wrench/geometry_msgs::msg::dds_::WrenchStamped_/RIHS01_8d")
    TopicKey(topic='/ft/wrench', type='geometry_msgs/msg/WrenchStamped', hash='RIHS01_8d')
    >>> parse_key("ft/wrench")
    TopicKey(topic='/ft/wrench', type=None, hash=None)
    """
    parts = key.split("/")
    dds = _DDS_TYPE.fullmatch(parts[-2]) if len(parts) >= 4 else None
    if dds is None:
        return TopicKey(f"/{key}", None, None)
    return TopicKey("/" + "/".join(parts[1:-2]), f"{dds['package']}/msg/{dds['name']}", parts[-1])


def _dds(name: str) -> str:
    package, _, kind = name.split("/")
    return f"{package}::msg::dds_::{kind}_"


def _path(topic: str) -> str:
    return "/" + topic.strip("/")


class _as_source:  # noqa: N801 - reads as a statement
    """Context that raises a RecordingError of its block as a SourceError with the same text."""

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, RecordingError):
            raise SourceError(str(error)) from error
