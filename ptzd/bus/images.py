"""Pictures go out from a thread of their own: a stalled subscriber may hold up a put for milliseconds."""

from __future__ import annotations

import threading
from typing import cast

import msgspec
import zenoh

from ptzd.bus.keys import IMAGE_KEYS, Keys
from ptzd.bus.messages import IMAGE_ENCODING
from ptzd.outgoing import ImageAttachment


class ImagePublisher:
    """Publishes the newest picture of each key, only while somebody listens; older ones that still wait are replaced.

    Parameters
    ----------
    session : zenoh.Session
        Open session.
    keys : Keys
        Where the pictures go.
    """

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self._session = session
        self._keys = keys
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._waiting: dict[str, tuple[bytes, ImageAttachment]] = {}
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="ptzd-images", daemon=True)
        self.replaced = 0
        """Pictures that a newer one replaced before they were sent."""
        self.sent = 0
        """Pictures handed to Zenoh."""

    def start(self) -> None:
        """Declare the keys and start the thread."""
        for key in IMAGE_KEYS:
            self._publishers[key] = self._session.declare_publisher(
                self._keys.full(key),
                encoding=IMAGE_ENCODING,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW,
            )
        self._thread.start()

    def stop(self) -> None:
        """End the thread; waits for a put under way (blocking, some ms)."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join()
        for publisher in self._publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]  # untyped in the stub

    def wanted(self, key: str) -> bool:
        """Whether anybody listens to ``image/fisheye``, ``image/ptz`` or ``image/overlay``."""
        # The stub says bool, the library returns an object that is always true.
        return cast("zenoh.MatchingStatus", self._publishers[key].matching_status).matching

    def offer(self, key: str, jpeg: bytes, attachment: ImageAttachment) -> None:
        """Hand over a picture; returns at once."""
        if not self.wanted(key):
            return
        with self._changed:
            self.replaced += key in self._waiting
            self._waiting[key] = (jpeg, attachment)
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if self._closing:
                    return
                key = next(iter(self._waiting))
                jpeg, attachment = self._waiting.pop(key)
            self.sent += 1
            self._publishers[key].put(jpeg, attachment=msgspec.json.encode(attachment))
