"""A client's view of one request: its feedback as it comes, its result when it is there."""

from __future__ import annotations

import asyncio

import msgspec
import zenoh
from zenoh.handlers import Callback

from ptzd.bus.keys import Keys
from ptzd.bus.mailbox import Mailbox
from ptzd.bus.messages import Feedback, RoiResult

FEEDBACK_KEPT = 1024
"""Steps that may wait to be read; older ones are dropped."""


class Following:
    """Listens to everything under ``roi/<id>`` from construction on.

    Parameters
    ----------
    session : zenoh.Session
        Open session.
    keys : Keys
        Of the rig.
    request_id : str
        The request.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, request_id: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._request_id = request_id
        self.result_key = keys.of_request(request_id, "result")
        self.result: asyncio.Future[RoiResult] = self._loop.create_future()
        """Done when the request has ended."""
        self._steps: Mailbox[Feedback] = Mailbox(self._loop, FEEDBACK_KEPT, evict=True)
        self._subscriber: zenoh.Subscriber[None] | None = session.declare_subscriber(
            self.result_key.rpartition("/")[0] + "/*", Callback(self._receive, indirect=False)
        )

    async def steps(self, wait_s: float) -> list[Feedback]:
        """Steps that wait; when there are none, those that come within ``wait_s``."""
        try:
            async with asyncio.timeout(wait_s):
                return await self._steps.take()
        except TimeoutError:
            return []

    def settle(self, result: RoiResult) -> None:
        """The result is known; called on the loop."""
        if not self.result.done():
            self.result.set_result(result)
            self.end()

    def end(self) -> None:
        """Listen no longer; harmless when repeated."""
        self._steps.close()
        if self._subscriber is not None:
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]  # untyped in the stub
            self._subscriber = None

    def _receive(self, sample: zenoh.Sample) -> None:
        leaf = str(sample.key_expr).rpartition("/")[2]
        try:
            if leaf == "feedback":
                self._steps.push(msgspec.json.decode(sample.payload.to_bytes(), type=Feedback))
            elif leaf == "result":
                result = msgspec.json.decode(sample.payload.to_bytes(), type=RoiResult)
                if result.id == self._request_id:
                    self._loop.call_soon_threadsafe(self.settle, result)
        except (msgspec.DecodeError, UnicodeDecodeError, RuntimeError):
            # Not from a ptzd (too deeply nested: RuntimeError), or our loop has ended: nothing to tell this request.
            return
