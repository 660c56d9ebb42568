"""The opening of a Robotiq gripper on an arm of Universal Robots, read through Robotiq's URCap.

The URCap listens on the robot's controller, TCP port 63352, and answers lines of ASCII. What is read:
  GET POS  "POS n", 0 to 255: the fingers' position by the encoder, 0 open, 255 closed (Robotiq, instruction
           manual of 2F-85 and 2F-140, register POSITION);
  GET STA  3 once the gripper is activated, which calibrates those counts (the same, register GRIPPER STATUS);
  GET FLT  0 without a fault; it is asked for only where the gripper is not activated.
Whether an answer ends with a line feed is not documented: the first answer of a connection shows it.
Nothing is commanded. None of this was tried with a gripper.

Rules
1. The opening is linear between the two counts of the gripper's description (`grippers.json`).
2. A width is known for STALE_S after it was read. Then it is unknown until the gripper answers again. This is
   shorter than the 0.2 s of an unchanged width that the service reads as fingers at rest.
3. An answer that is missing or wrong ends the connection; the next begins with GET STA.
"""

from __future__ import annotations

import logging
import re
import socket
import threading
import time
from contextlib import suppress
from typing import NamedTuple

from caesura_protocol.errors import SourceError
from caesura_protocol.robots import GripperDescription

logger = logging.getLogger(__name__)

PORT = 63352  # of the URCap
POLL_S = 0.02  # between two questions
POLLS_PER_STATUS = 25  # positions that are read before the status is read again
STALE_S = 0.15  # after which a width is unknown
CONNECT_S = 2.0
ANSWER_S = 0.5
LINE_END_S = 0.02  # in which the rest of an answer without a line feed arrives
LONGEST_ANSWER = 64  # bytes
FIRST_RETRY_S, LONGEST_RETRY_S = 0.1, 2.0  # between two connections; doubled each time
ACTIVATED = 3  # of STA
MOST_COUNTS = 255
REMEDY = "Install Robotiq's URCap, activate the gripper on the pendant, or state --no-gripper"


class GripperSilentError(Exception):
    """A gripper that cannot be read; the text states why."""


class _Reading(NamedTuple):
    width: float  # [m]
    at_s: float  # monotonic


class UrcapGripper:
    """A Robotiq gripper whose opening a separate thread reads at up to 50 Hz.

    who: name of the gripper in errors and the log. Raises SourceError if the first read fails.
    """

    failure: str | None = None  # such a gripper is waited for

    def __init__(self, who: str, host: str, gripper: GripperDescription) -> None:
        self._address = host, PORT
        self._name = f"{who}: its {gripper.title} at {host}:{PORT}"
        self._gripper = gripper
        self._over = threading.Event()
        try:
            self._connection = _Connection(self._address)
            self._newest = self._read()
        except GripperSilentError as error:
            raise SourceError(f"{self._name}: {error}. {REMEDY}") from error
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()

    @property
    def width(self) -> float | None:
        """The opening [m]; None if the last read is older than STALE_S."""
        width, at_s = self._newest
        return width if time.monotonic() - at_s <= STALE_S else None

    def close(self) -> None:
        """End the thread and the connection."""
        self._over.set()
        self._connection.interrupt()
        self._thread.join(CONNECT_S + ANSWER_S)

    def _run(self) -> None:
        try:
            while not self._over.wait(POLL_S):
                try:
                    self._newest = self._read()
                except GripperSilentError as error:
                    self._reconnect(error)
        finally:
            self._connection.close()

    def _read(self) -> _Reading:
        """Read the position; its time is that of the request. Raises GripperSilentError."""
        asked_s = time.monotonic()
        return _Reading(self._gripper.width_m(self._connection.position()), asked_s)

    def _reconnect(self, error: GripperSilentError) -> None:
        """Reconnect until a position is read or the source closes; log once that samples stop."""
        self._connection.close()
        wait_s, is_logged = FIRST_RETRY_S, False
        while not self._over.wait(wait_s):
            wait_s = min(2.0 * wait_s, LONGEST_RETRY_S)
            if self.width is None and not is_logged:
                logger.warning("%s: %s. No samples until it answers again", self._name, error)
                is_logged = True
            try:
                self._connection = _Connection(self._address)
                self._newest = self._read()
            except GripperSilentError:
                continue
            if is_logged:
                logger.warning("%s: answers again", self._name)
            return


class _Connection:
    """A connection to the URCap of an activated gripper. Raises GripperSilentError where there is none."""

    def __init__(self, address: tuple[str, int]) -> None:
        try:
            self._socket = socket.create_connection(address, CONNECT_S)
        except OSError as error:
            raise GripperSilentError(f"cannot connect: {error}") from error
        self._positions = 0
        self._has_line_feeds: bool | None = None  # until the first answer
        try:
            self._check_activated()
        except GripperSilentError:
            self.close()
            raise

    def position(self) -> int:
        """The fingers' position [counts]; checks now and then that the gripper is still activated."""
        self._positions += 1
        try:
            if self._positions % POLLS_PER_STATUS == 0:
                self._check_activated()
            count = self._value("POS")
            if count > MOST_COUNTS:
                raise GripperSilentError(f"POS is {count}, expected 0 to {MOST_COUNTS}")
        except GripperSilentError:
            self.close()
            raise
        return count

    def interrupt(self) -> None:
        """Shut the socket down, which ends a read in another thread."""
        with suppress(OSError):  # it is closed
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._socket.close()

    def _check_activated(self) -> None:
        status = self._value("STA")
        if status != ACTIVATED:
            fault = self._value("FLT")
            raise GripperSilentError(
                f"it is not activated: STA is {status}, expected {ACTIVATED}; FLT is {fault}"
            )

    def _value(self, variable: str) -> int:
        """Query a variable. Raises GripperSilentError if the answer is not its number."""
        try:
            self._socket.sendall(f"GET {variable}\n".encode("ascii"))
            answer = self._answer()
        except TimeoutError as error:
            raise GripperSilentError(f"no answer to GET {variable} within {ANSWER_S:g} s") from error
        except OSError as error:
            raise GripperSilentError(f"the connection was lost: {error}") from error
        found = re.fullmatch(rf"{variable} ([0-9]{{1,9}})\s*".encode("ascii"), answer)
        if found is None:
            shown = answer.decode("ascii", "backslashreplace")
            expected = f"{variable} and a number"
            raise GripperSilentError(f"GET {variable} was answered {shown!r}, expected {expected}")
        return int(found[1])

    def _answer(self) -> bytes:
        """Return one answer, with or without its line feed."""
        self._socket.settimeout(ANSWER_S)
        answer = self._part()
        if not self._has_line_feeds:
            self._socket.settimeout(LINE_END_S)
        while not answer.endswith(b"\n") and len(answer) < LONGEST_ANSWER:
            try:
                answer += self._part()
            except TimeoutError:
                if self._has_line_feeds:
                    raise
                break
        self._has_line_feeds = answer.endswith(b"\n")
        return answer

    def _part(self) -> bytes:
        part = self._socket.recv(LONGEST_ANSWER)
        if not part:
            raise ConnectionError("the URCap closed the connection")
        return part
