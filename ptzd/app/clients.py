"""Commands that only ask a running daemon: what the command line does with :class:`ptzd.bus.client.Client`."""

from __future__ import annotations

from collections.abc import AsyncIterator

import msgspec

from ptzd.bus.by_hand import LensWanted, MoveReply, MoveRequest, PanTilt, PixelPtz, Speed, Step
from ptzd.bus.client import Client
from ptzd.bus.fields import BoxPx
from ptzd.bus.known_ranges import RangeKnown, RangesReply, RangesRequest
from ptzd.bus.messages import MESSAGES, Feedback, LeaseRequest, RoiResult, Status, schema
from ptzd.model import GotoShown, LeaseHeld, PatrolShown
from ptzd.outgoing import MotorStatus, Pose, ShadowPose

__all__ = [
    "BoxPx",
    "Client",
    "Feedback",
    "GotoShown",
    "LeaseHeld",
    "LeaseRequest",
    "LensWanted",
    "MotorStatus",
    "MoveReply",
    "MoveRequest",
    "PanTilt",
    "PatrolShown",
    "PixelPtz",
    "Pose",
    "RangeKnown",
    "RangesReply",
    "RangesRequest",
    "RoiResult",
    "ShadowPose",
    "Speed",
    "Status",
    "Step",
    "message_schema",
    "message_types",
    "notices",
]


def message_schema(name: str) -> dict[str, object]:
    """JSON Schema of a bus message."""
    return schema(name)


def message_types() -> list[str]:
    """Names of the bus messages."""
    return list(MESSAGES)


async def notices(client: Client) -> AsyncIterator[tuple[str, dict[str, object]]]:
    """Everything a rig says, as type name and document."""
    async for notice in client.watch():
        yield type(notice).__name__, msgspec.to_builtins(notice)
