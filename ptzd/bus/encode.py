"""From messages of an app to payloads: whole and checked before anything leaves, by the rules of the daemon's side.

JSON has no NaN and no infinity, and encoders write ``null`` for them, which where a field may be absent would mean the
default: so the message itself is looked at, before it is written.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from ptzd.bus.decode import check, decode, not_finite
from ptzd.bus.fields import Incoming
from ptzd.bus.messages import encoding
from ptzd.errors import RequestRefused


@dataclass(frozen=True, slots=True)
class Encoded:
    """A message that may leave; only :func:`encode` makes one."""

    payload: bytes
    encoding: str


def encode(message: Incoming) -> Encoded:
    """Write a message to the daemon.

    Raises
    ------
    RequestRefused
        ``invalid`` with the path of the culprit, as the daemon would tell it.
    """
    path = not_finite(msgspec.to_builtins(message), "$")
    if path is not None:
        raise RequestRefused("invalid", "must be a finite number; leave it out for the default", path)
    try:
        payload = msgspec.json.encode(message)
    except UnicodeEncodeError as error:
        text = error.object[error.start : error.end]
        raise RequestRefused("invalid", f"a text holds {text!a}, which is no character", "$") from None
    check(decode(payload, type(message)))
    return Encoded(payload, encoding(type(message).__name__))
