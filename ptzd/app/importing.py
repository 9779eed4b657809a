"""`ptzd presets`: the camera's own presets as places on the sphere, which survive a calibration of the mount."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import yaml

from ptzd.app.loading import Loaded
from ptzd.control.planning.places import place_seen
from ptzd.devices.vapix.address import Address
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.credentials import read_credentials
from ptzd.devices.vapix.presets import StoredPreset, read_presets
from ptzd.errors import ConfigError
from ptzd.geometry.rig import Rig
from ptzd.presets import Place, check_names
from ptzd.runtime.clock import SteadyClock

DIGITS = 4
"""Of the angles: a hundredth of a camera's encoder step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """What became of a camera's presets."""

    places: dict[str, Place]
    left_out: tuple[str, ...]
    """One sentence each."""

    def text(self) -> str:
        """As ``presets.yaml`` has it."""
        document = {
            "places": {
                name: {
                    "azimuth_deg": round(place.azimuth_deg, DIGITS),
                    "elevation_deg": round(place.elevation_deg, DIGITS),
                    "hfov_deg": round(place.hfov_deg, DIGITS),
                }
                for name, place in self.places.items()
            }
        }
        return yaml.safe_dump(document, sort_keys=False, allow_unicode=True)


async def import_presets(loaded: Loaded) -> Imported:
    """Ask the camera, which is not moved.

    Raises
    ------
    DeviceError, ConfigError
        When it does not answer, or its password cannot be read.
    """
    ptz = loaded.config.ptz
    address = Address(
        url=ptz.url,
        setting="ptz",
        allow_basic_over_http=ptz.allow_basic_over_http,
        certificate_sha256=ptz.certificate_sha256,
    )
    async with CameraClient(address, SteadyClock(), only_asks=True) as client:
        client.use(read_credentials(ptz.user, ptz.password_file, setting="ptz"))
        return as_places(loaded.rig, await read_presets(client, ptz.camera))


def as_places(rig: Rig, presets: Sequence[StoredPreset]) -> Imported:
    """Places of those that can be some, and why the others cannot."""
    low, high = rig.zoom.zoom_range
    places: dict[str, Place] = {}
    left_out = []
    for preset in presets:
        who, reading = f"preset {preset.number} {preset.name[:40]!r} is left out", preset.reading
        try:
            check_names([*places, preset.name], "its name")
        except ConfigError as error:
            left_out.append(f"{who}: {error}")
            continue
        if reading is None:
            left_out.append(f"{who}: the camera does not say where it is")
        elif preset.name in places:
            left_out.append(f"{who}: another one has the same name; rename it in the camera")
        elif not low <= reading.zoom <= high:
            left_out.append(f"{who}: zoom {reading.zoom:g} is outside what is calibrated, {low:g} to {high:g}")
        else:
            places[preset.name] = place_seen(rig, reading)
    return Imported(places=places, left_out=tuple(left_out))
