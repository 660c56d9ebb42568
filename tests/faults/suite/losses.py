"""The power goes: the service is killed, and its journal becomes what had been fsynced by then.

The stations have their rings and would send everything once more. So there is a ledger beside them without a
ring: a session of which a batch and an edit are acknowledged right before each loss.
"""

from __future__ import annotations

import random
import time
from dataclasses import replace
from pathlib import Path

from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.session_corrections import send
from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Ack, Edit, Insert, Open
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.outcome import FULL, Disturbance, Row, Scale, played
from faults.suite.stations import (
    CONNECT_S,
    SESSION,
    SETTINGS,
    STATIONS,
    TaughtStation,
    demonstration,
    reached,
)
from harness.power import COMPILER, NO_COMPILER, Power
from harness.processes import ServiceProcess, eventually

LOSSES = 10
SEED = 8
LEDGER = "ledger"
ROWS = 200  # samples of one of its batches, a second
PACE = 0.5
PATIENT = replace(SETTINGS, close_timeout_s=600.0)  # the last losses may come after the end


class Ledger:
    """A session that keeps nothing itself."""

    def __init__(self) -> None:
        recording = demonstration(STATIONS)
        self._rows, self._columns = recording.matrix(), recording.columns
        self._opening = Open(session=SESSION, columns=self._columns, wrench_source="flange_sensor")
        self.batches = self.edits = 0  # that were acknowledged

    def state(self, transport: ZenohTransport) -> Ack:
        """What the service says that it has."""
        acks: list[Ack] = []

        def reported() -> bool:
            ack = ControlClient(transport, LEDGER).ask(self._opening)
            acks[:] = [ack] if ack else []
            return bool(acks)

        eventually(reported)
        return acks[0]

    def write(self, endpoint: str) -> None:
        """A batch and an edit more; returns once both are acknowledged."""
        with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
            self.state(transport)
            seq = self.batches
            rows = self._rows[seq * ROWS : (seq + 1) * ROWS]
            batch = pack_samples(rows, self._columns, session=SESSION, epoch=0, seq=seq)
            key = station_key(LEDGER, "samples")

            def taken() -> bool:
                transport.put(key, encode(batch))
                return self.state(transport).next_seq > seq

            eventually(taken)
            self.batches += 1
            action = Insert(t=float(rows[ROWS // 2, 0]))
            made = Edit(session=SESSION, revision=self.edits, author="ledger", action=action)
            self.edits = send(transport, LEDGER, made).revision

    def forgotten(self, endpoint: str) -> int:
        """Acknowledged batches and edits that the service does not have; from here on they do not count."""
        with ZenohTransport(endpoint, timeout_s=CONNECT_S) as transport:
            ack = self.state(transport)
        missing = max(0, self.batches - ack.next_seq) + max(0, self.edits - ack.revision)
        self.batches, self.edits = ack.next_seq, ack.revision
        return missing


def power_loss(directory: Path, scale: Scale | None = None, losses: int = LOSSES) -> Row:
    """At a random moment of each part of the demonstrations."""
    if COMPILER is None:
        return Row(0, 0, 0, 0, "–", None, NO_COMPILER, met=False)
    scale = scale or Scale(FULL.stations, FULL.seconds, PACE)
    rng = random.Random(SEED)
    power, ledger = Power(directory / "journal", directory), Ledger()
    forgotten: list[int] = []
    service = ServiceProcess(power.directory)
    service.command = power.command(service.command)

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        for part in range(losses):
            reached(stations, (part + rng.uniform(0.1, 0.8)) / losses)
            ledger.write(service.endpoint)
            service.kill()
            power.lose()
            disturbance.is_over()
            service.start()
            starting_s.append(time.monotonic() - disturbance.over[-1])
            forgotten.append(ledger.forgotten(service.endpoint))

    starting_s: list[float] = []
    try:
        service.start()
        done = played(service.endpoint, power.directory, disturb, scale=scale, settings=PATIENT)
    finally:
        service.kill()
    note = f"{losses} losses; acknowledged and forgotten: {sum(forgotten)}; recovery: the longest start"
    row = done.row(note=note, met=not any(forgotten))
    return replace(row, recovery_s=max(starting_s))  # after the end there is no new result to wait for
