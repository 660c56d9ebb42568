"""A WebSocket server for Foxglove, with the channels of an MCAP file. Needs the extra `foxglove`.

The server queues at most BACKLOG messages for a slow viewer, drops the oldest beyond that, and lists its
channels to each viewer.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from types import TracebackType
from typing import Self

import foxglove
from foxglove.websocket import ChannelView, Client, ServerListener, WebSocketServer

from caesura_clients.viewer.live_mcap_messages import LiveMessage
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.mcap_schemas import CHANNELS, schema_of
from caesura_protocol.number_words import counted

BACKLOG = 16384  # messages for a slow viewer: five seconds of a robot at 1 kHz
LINKS = "foxglove.websocket.connected_client.poller"  # logger of the SDK
_ENCODE = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


class FoxgloveServer:
    """Serves viewers while its context lasts; a sink for `StationFeed`.

    port: 0 chooses a free one. Entering the context raises CaesuraError if the server cannot listen.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        self.on_subscribe: Callable[[str], None] = lambda topic: None  # called from the server's own thread
        self._context = foxglove.Context()
        self._channels = {
            topic: foxglove.Channel(
                topic,
                message_encoding="json",
                schema=foxglove.Schema(
                    name=schema_name, encoding="jsonschema", data=json.dumps(schema_of(topic)).encode()
                ),
                context=self._context,
            )
            for topic, (schema_name, _) in CHANNELS.items()
        }
        logging.getLogger(LINKS).setLevel(logging.CRITICAL)  # a viewer that goes is no error
        self._name, self._host, self._port = name, host, port
        self._server: WebSocketServer | None = None

    @property
    def port(self) -> int:
        """The port on which it listens."""
        return self._port if self._server is None else self._server.port

    def __enter__(self) -> Self:
        try:
            self._server = foxglove.start_server(
                name=self._name,
                host=self._host,
                port=self._port,
                context=self._context,
                server_listener=_Listener(self),
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise CaesuraError(f"{self._host}:{self._port}: {error}; choose another with --port") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.stop()

    def publish(self, message: LiveMessage) -> None:
        """Send a message to every subscriber of its topic; without a subscriber it is not encoded."""
        channel = self._channels[message.topic]
        if channel.has_sinks():
            channel.log(_ENCODE(message.fields), log_time=message.log_time)

    def state(self, session: str, missing: int) -> None:
        """Show the session in the viewer's list of problems, as information, or as a warning."""
        level = foxglove.StatusLevel.Warning if missing else foxglove.StatusLevel.Info
        lost = f": {counted(missing, 'batch')} not received" if missing else ""
        if self._server is not None:
            self._server.publish_status(f"session {session}{lost}", level, "session")


class _Listener(ServerListener):
    def __init__(self, server: FoxgloveServer) -> None:
        self._server = server

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._server.on_subscribe(channel.topic)
