"""The positions that a camera keeps under names: server presets, with what ``param.cgi`` tells of where they are."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.devices.vapix import requests
from ptzd.devices.vapix.client import CameraClient
from ptzd.model import HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPreset:
    """One preset of the camera."""

    number: int
    name: str
    reading: HeadReading | None
    """Where it is; None when the camera does not say so in full."""


async def read_presets(client: CameraClient, camera: int) -> list[StoredPreset]:
    """Ask for every preset of a channel, by number.

    Raises
    ------
    DeviceError
        The camera does not answer, refuses, or cannot be understood.
    """
    names = await client.send(requests.preset_names(camera))
    group = f"PTZ.Preset.P{camera - 1}"
    stored = await client.send(requests.parameters(group))
    return [
        StoredPreset(number=number, name=name, reading=_reading(stored.get(f"{group}.Position.P{number}.Data")))
        for number, name in sorted(names.items())
    ]


def _reading(data: str | None) -> HeadReading | None:
    """Take ``tilt=24.628906:focus=32766.000000:pan=-1.425781:iris=32766.000000:zoom=154.000000`` by key."""
    fields = dict(part.partition("=")[::2] for part in (data or "").split(":"))
    try:
        return HeadReading(
            pan_deg=float(fields["pan"]), tilt_deg=float(fields["tilt"]), zoom=max(float(fields["zoom"]), 1.0)
        )
    except (KeyError, ValueError):
        return None
