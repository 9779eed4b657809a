"""What is put or asked under the rig's keys and means nothing there: told, so that no word vanishes in silence.

Somebody who looks around with a wildcard asks for nothing and is let go.
"""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches

import zenoh

from ptzd.bus.arrivals import Arrival
from ptzd.bus.decode import refused
from ptzd.bus.keys import Keys
from ptzd.bus.messages import ErrorReply
from ptzd.bus.replies import Replies
from ptzd.control.events import PayloadRefused
from ptzd.errors import RequestRefused

ORDINARY = "unknown"
SHOWN = 120
"""Characters of a key in a message."""


class Strays:
    """Handler of every key that no other handler takes.

    Parameters
    ----------
    keys : Keys
        Of this rig.
    answered, heard : collection of str
        Key expressions that queries, and puts, are served on.
    tell : Callable[[PayloadRefused], None]
        Takes the refusal of a put: it is logged, and told in the journal within bounds.
    replies : Replies
        Sends the answers.
    """

    def __init__(
        self,
        keys: Keys,
        answered: frozenset[str],
        heard: frozenset[str],
        tell: Callable[[PayloadRefused], None],
        replies: Replies,
    ) -> None:
        self._depth = keys.full("").count("/")
        self._answered = {self._word(key) for key in answered}
        self._heard = {self._word(key) for key in heard}
        self._tell = tell
        self._replies = replies

    def asked_in_vain(self, key: str) -> bool:
        """Whether a query spells out a key that nobody answers on."""
        return "*" not in self._word(key) and "**" not in key and not self._is_known(key, self._answered)

    def put_in_vain(self, key: str) -> bool:
        """Whether a put is on a key that nobody listens to, or on several at once, where nobody takes it for his."""
        return not self._is_known(key, self._heard)

    def on_query(self, arrival: Arrival) -> None:
        """A query that is in vain: answered with what there is."""
        if arrival.query is not None:
            message = self._message(arrival.key, self._answered)
            # not on the key: none of these is an operator's word, whose answers have a lane to themselves
            self._replies.refuse(arrival.query, ErrorReply(code="unknown_key", message=message), ORDINARY)

    def on_put(self, arrival: Arrival) -> None:
        """A put that is in vain: told to the journal with what there is."""
        self._refuse(self._message(arrival.key, self._heard))

    def on_delete(self, arrival: Arrival) -> None:
        """A delete, which is in vain everywhere."""
        self._refuse(f"{_shown(arrival.key)}: a delete does nothing; put or query it instead")

    def _refuse(self, message: str) -> None:
        self._tell(refused(RequestRefused("unknown_key", message, "$"), None, None))

    def _word(self, key: str) -> str:
        """What stands behind the rig's name."""
        return "/".join(key.split("/")[self._depth :])

    def _is_known(self, key: str, known: set[str]) -> bool:
        word = self._word(key)
        if not word or "**" in key:
            return False
        return any(zenoh.KeyExpr(one).includes(zenoh.KeyExpr(word)) for one in known)

    def _message(self, key: str, known: set[str]) -> str:
        word = self._word(key)
        if "*" in word or "**" in key:
            return f"{_shown(key)}: names several keys at once; spell out the one that is meant"
        near = get_close_matches(word.lower(), [_of_the_same_id(one, word) for one in known], 1)
        room = word.partition("/")[0]
        there = sorted(one for one in known if one.partition("/")[0] == room) or sorted(known)
        named = ", ".join(one.replace("*", "<id>") for one in there)
        meant = f"; did you mean {near[0]}?" if near else ""
        return f"{_shown(key)}: there is no such key{meant} (there are {named})"


def _of_the_same_id(known: str, word: str) -> str:
    """``roi/*/cancel`` as it would be for the request that the word names."""
    chunks = word.lower().split("/")
    return known.replace("*", chunks[1]) if len(chunks) > 1 else known


def _shown(key: str) -> str:
    return key if len(key) <= SHOWN else f"{key[:SHOWN]}…"
