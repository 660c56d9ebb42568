"""A bridge without our library: zenoh and msgpack are all it needs. The same in C++: minimal_bridge.cpp.

open → batches, numbered without holes → answer `replay` for what was missed → close, until acknowledged.
Every message is a msgpack map with an encoding that names its type; `docs/api.md` has them all.

    python minimal_bridge.py tcp/127.0.0.1:7447 cell-1
"""

import argparse
import json
import math
import struct
import sys
import threading
import time
from collections import OrderedDict

import msgpack
import zenoh

COLUMNS = ["t", "px", "py", "pz"]
BATCH, RATE_HZ, RING = 20, 1000.0, 6000  # samples, 1/s, batches: 120 s


def encoding(kind):
    """Return the encoding that names the type of a payload."""
    return f"application/msgpack;caesura.{kind}.v1"


class MinimalBridge:
    """One session of one station."""

    def __init__(self, session, station, name):
        self.session, self.name = session, name
        self.key = f"caesura/v1/station/{station}"
        self.ring = OrderedDict()  # seq → payload
        self.lock = threading.Lock()
        self.token = session.liveliness().declare_token(f"{self.key}/alive")
        self.replay = session.declare_queryable(f"{self.key}/replay", self.answer)

    def ask(self, command):
        """Send a command until the service answers; returns the Ack. A refusal ends the program.

        A close that comes before the last batch is no such refusal: `value` is the batch that is missing.
        """
        while True:
            replies = self.session.get(
                f"{self.key}/control",
                payload=msgpack.packb({"command": command}),
                encoding=encoding("Control"),
                timeout=2.0,
            )
            for reply in replies:
                if reply.ok is not None:
                    return msgpack.unpackb(reply.ok.payload.to_bytes())
                refusal = msgpack.unpackb(reply.err.payload.to_bytes())
                missing = command["type"] == "close" and refusal.get("limit") == command["last_seq"]
                if refusal["code"] == "conflict" and missing:
                    return {"state": "open", "next_seq": refusal["value"]}
                if refusal["code"] not in ("overloaded", "internal"):
                    raise SystemExit(f"{refusal['code']}: {refusal['message']}")
            time.sleep(0.2)

    def open(self):
        """Asking twice alike is no error."""
        return self.ask({"type": "open", "session": self.name, "columns": COLUMNS, "wrench_source": "none"})

    def put(self, seq, rows):
        """A batch: times as offsets from t0 in the first column, row after row, little-endian."""
        t0 = rows[0][0]
        cells = [value for t, *rest in rows for value in (t - t0, *rest)]
        batch = {
            "session": self.name,
            "epoch": 0,
            "seq": seq,
            "n": len(rows),
            "columns": COLUMNS,
            "t0": t0,
            "samples": struct.pack(f"<{len(cells)}d", *cells),
        }
        payload = msgpack.packb(batch)
        with self.lock:
            self.ring[seq] = payload
            if len(self.ring) > RING:
                self.ring.popitem(last=False)
        self.send(payload)

    def send(self, payload):
        """DROP: a robot must not wait for the network; what is dropped is asked for again."""
        self.session.put(
            f"{self.key}/samples",
            payload,
            encoding=encoding("SampleBatch"),
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def answer(self, query):
        """`from=3;to=9;max=100`: a reply for each batch, or `evicted` with the oldest that there is."""
        with query:
            if query.parameters.get("session", self.name) != self.name:
                error = {"code": "unknown_session", "message": "not mine"}
                query.reply_err(msgpack.packb(error), encoding=encoding("Error"))
                return
            wanted = {key: int(query.parameters.get(key)) for key in ("from", "to", "max")}
            with self.lock:
                held = dict(self.ring)
            if held and wanted["from"] < min(held):
                error = {"code": "evicted", "message": "too old", "value": wanted["from"], "limit": min(held)}
                query.reply_err(msgpack.packb(error), encoding=encoding("Error"))
                return
            for seq in range(wanted["from"], min(wanted["to"], wanted["from"] + wanted["max"] - 1) + 1):
                if seq in held:
                    query.reply(f"{self.key}/replay", held[seq], encoding=encoding("SampleBatch"))

    def close(self, last_seq):
        """Until the service has everything: what it misses, it asks for or is sent again."""
        while True:
            ack = self.ask({"type": "close", "session": self.name, "last_seq": last_seq})
            if ack["state"] == "closed":
                return ack
            for seq in range(ack["next_seq"], last_seq + 1):
                self.send(self.ring[seq])
            time.sleep(0.1)


def robot(seconds):
    """A hand that goes to and fro; put the reading of your robot here."""
    for i in range(round(seconds * RATE_HZ)):
        t = i / RATE_HZ
        yield [t, 0.4 + 0.1 * math.sin(2.0 * t), 0.0, 0.3]


def main(endpoint, station, seconds):
    """Teach for some seconds."""
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        opened = zenoh.open(config)
    except zenoh.ZError:
        sys.exit(f"error: no router at {endpoint}: start `caesura serve`, or name another endpoint")
    with opened as session:
        bridge = MinimalBridge(session, station, f"s{time.strftime('%Y%m%d-%H%M%S')}")
        bridge.open()
        begun, seq, rows = time.monotonic(), 0, []
        for row in robot(seconds):
            rows.append(row)
            if len(rows) == BATCH:
                bridge.put(seq, rows)
                seq, rows = seq + 1, []
                time.sleep(max(0.0, begun + row[0] - time.monotonic()))
        if rows:
            bridge.put(seq, rows)
            seq += 1
        ack = bridge.close(seq - 1)
        print(f"{station}/{bridge.name} {ack['state']}, {ack['next_seq']} batches")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("endpoint", nargs="?", default="tcp/127.0.0.1:7447")
    parser.add_argument("station", nargs="?", default="cell-1")
    parser.add_argument("seconds", type=float, nargs="?", default=5.0)
    main(**vars(parser.parse_args()))
