from __future__ import annotations

import asyncio
import threading

from ptzd.bus.images import ImagePublisher
from ptzd.bus.keys import Keys
from ptzd.outgoing import ImageAttachment

JPEG = b"\xff\xd8" + bytes(1000) + b"\xff\xd9"


async def known(client) -> None:
    """What the client declared before lies ahead of this question on the same link."""
    await asyncio.sleep(0)  # a task that was just made declares in its first step
    await client.status()


async def test_only_who_listens_is_served(bus, client):
    assert not bus.image_wanted("image/fisheye")
    bus.publish_image("image/fisheye", JPEG, ImageAttachment(seq=0, t_capture_ns=0, w=64, h=48))
    pictures = client.images("fisheye")
    first = asyncio.ensure_future(anext(pictures))
    await known(client)
    assert bus.image_wanted("image/fisheye")
    assert not bus.image_wanted("image/ptz")
    bus.publish_image("image/fisheye", JPEG, ImageAttachment(seq=3, t_capture_ns=5, w=64, h=48, pan_deg=1.5))
    picture = await first
    assert picture.jpeg == JPEG
    assert (picture.attachment.seq, picture.attachment.pan_deg, picture.attachment.zoom) == (3, 1.5, None)
    await pictures.aclose()
    await known(client)
    assert not bus.image_wanted("image/fisheye")
    assert bus.counters()["images_sent"] == 1


async def test_a_large_picture_arrives_whole(bus, client):
    pictures = client.images("ptz")
    first = asyncio.ensure_future(anext(pictures))
    await known(client)
    jpeg = bytes(range(256)) * 8000
    while not first.done():  # a busy link may drop a picture; a camera has the next one soon
        bus.publish_image("image/ptz", jpeg, ImageAttachment(seq=1, t_capture_ns=2, w=1, h=1))
        await asyncio.wait([first], timeout=0.5)
    assert (await first).jpeg == jpeg
    await pictures.aclose()


class StalledPublisher:
    """Holds every put up until told to go on."""

    class matching_status:  # noqa: N801 - shaped like Zenoh's
        matching = True

    def __init__(self) -> None:
        self.go = threading.Event()
        self.busy = threading.Event()
        self.sent: list[bytes] = []

    def put(self, payload: bytes, *, attachment: bytes) -> None:
        self.busy.set()
        self.go.wait()
        self.sent.append(payload)

    def undeclare(self) -> None:
        pass


class StalledSession:
    def __init__(self, publisher: StalledPublisher) -> None:
        self._publisher = publisher

    def declare_publisher(self, *_args, **_kwargs) -> StalledPublisher:
        return self._publisher


def test_a_stalled_subscriber_costs_pictures_but_no_time():
    stalled = StalledPublisher()
    images = ImagePublisher(StalledSession(stalled), Keys("ptzd", "hall"))
    images.start()
    images.offer("image/ptz", b"0", {})
    assert stalled.busy.wait(100)
    for index in range(1, 101):
        images.offer("image/ptz", b"%d" % index, {})
        images.offer("image/fisheye", b"f%d" % index, {})
    stalled.busy.clear()
    stalled.go.set()
    while len(stalled.sent) < 3:
        stalled.busy.wait(0.01)
    images.stop()
    assert stalled.sent[0] == b"0"
    assert set(stalled.sent[1:]) == {b"100", b"f100"}
    assert images.replaced == 198
