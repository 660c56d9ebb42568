"""The errors of a client, except for a peer's refusal, which is a ProtocolError."""

from __future__ import annotations


class CaesuraError(Exception):
    """Something a user can act on; the message is one line and names what was found and what would do."""


class Unreachable(CaesuraError):  # noqa: N818 - a state, and it reads better where it is caught
    """No answer: there is no router at the endpoint, or no service behind it."""


class NotLetIn(Unreachable):
    """A router is there and refuses us: credentials that waiting does not change."""


class Absent(CaesuraError):  # noqa: N818
    """A station or session that was asked for is not there; the message names those that are."""


class BadSource(CaesuraError):  # noqa: N818
    """A source delivered what cannot be sent: wrong shape, a value that is not finite, an unknown name."""
