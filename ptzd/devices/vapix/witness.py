"""The camera's own word on whether it moves: the event stream over WebSocket (AXIS OS 10.11 and later).

A second witness beside the position reports: it proves rest sooner. A camera without it, or one that stops telling, is
judged by its reports alone.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable

import aiohttp

from ptzd.backoff import Backoff
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.failures import NotOffered
from ptzd.devices.vapix.poses import PoseRing
from ptzd.errors import DeviceError, DeviceGarbled, DeviceRefused
from ptzd.ports import Clock

STREAM = "/vapix/ws-data-stream"
TOPIC = "tns1:PTZController/tnsaxis:Move//."


class MotionWitness:
    """Tells the poses when the camera says that it starts and stops.

    Parameters
    ----------
    client : CameraClient
    poses : PoseRing
    clock : Clock
    camera : int
        Channel, from 1.
    jitter : callable
        Random numbers in [0, 1) for the pauses between attempts.

    Attributes
    ----------
    listening : bool
        Whether the camera is telling at the moment.
    """

    def __init__(
        self, client: CameraClient, poses: PoseRing, clock: Clock, camera: int, jitter: Callable[[], float]
    ) -> None:
        self.listening = False
        self._client = client
        self._poses = poses
        self._clock = clock
        self._channel = f"Channel_{camera}"
        self._backoff = Backoff(jitter=jitter)

    async def run(self) -> None:
        """Listen, again and again; returns when the camera does not offer events to this account."""
        while True:
            try:
                await self._listen()
            except (NotOffered, DeviceRefused):
                return
            except DeviceError:
                await asyncio.sleep(self._backoff.pause_s())
            finally:
                self.listening = False

    async def _listen(self) -> None:
        token = await self._client.send(requests.event_session())
        async with self._client.websocket(STREAM, {"wssession": token, "sources": "events"}) as socket:
            filters = {"eventFilterList": [{"topicFilter": TOPIC}]}
            await socket.send_json({"apiVersion": "1.0", "method": "events:configure", "params": filters})
            async for message in socket:
                if message.type is aiohttp.WSMsgType.TEXT:
                    self._hear(message.data)
            raise DeviceGarbled("the event stream ended")

    def _hear(self, text: str) -> None:
        moving = is_moving(text, self._channel)
        if moving is None:
            return
        self.listening = True
        self._backoff.reset()
        if moving:
            self._poses.started()
        else:
            self._poses.stopped(self._clock.now_ns())


def is_moving(text: str, channel: str) -> bool | None:
    """What a message of the event stream says of this channel's motion; None for any other message.

    Raises
    ------
    DeviceGarbled
        The message is not JSON, or the camera refuses the subscription.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        raise DeviceGarbled("an event is not JSON") from None
    if not isinstance(message, dict):
        return None
    if "error" in message:
        raise DeviceRefused("the camera does not give its motion events")
    notification = _at(message, "params", "notification")
    topic = _at(notification, "topic")
    value = _at(notification, "message", "data", "is_moving")
    # a tuple: what JSON holds need not be hashable
    if not isinstance(topic, str) or not topic.endswith(f"Move/{channel}") or value not in ("0", "1"):
        return None
    return value == "1"


def _at(value: object, *keys: str) -> object:
    for key in keys:
        if not isinstance(value, dict):
            return None
        value = value.get(key)
    return value
