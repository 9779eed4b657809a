"""A script: what the simulated camera is like, and what happens to it when (``ptzd sim --faults FILE``)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from ptzd.documents import DocumentError, parse_yaml, read_text
from ptzd.errors import SimulationError
from ptzd.sim.auth import Policy, Role
from ptzd.sim.faults import Fault
from ptzd.sim.settings import SimSettings

Seconds = Annotated[float, Meta(gt=0)]


class CameraChanges(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a script may say of the camera; the fields are those of :class:`SimSettings`."""

    profile: str | UnsetType = UNSET
    policy: Policy | UnsetType = UNSET
    basic_first: bool | UnsetType = UNSET
    https: bool | UnsetType = UNSET
    nonce_life_s: Seconds | UnsetType = UNSET
    role: Literal["viewer", "operator", "administrator"] | UnsetType = UNSET
    ptz_right: bool | UnsetType = UNSET
    e_flip_tilt_deg: Annotated[float, Meta(ge=-180, lt=-90)] | UnsetType = UNSET
    digital_zoom: bool | UnsetType = UNSET
    auto_exposure: bool | UnsetType = UNSET
    image_latency_s: Seconds | UnsetType = UNSET
    boot_s: Seconds | UnsetType = UNSET
    max_viewers: Annotated[int, Meta(ge=1)] | UnsetType = UNSET
    seed: int | UnsetType = UNSET


class Script(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A camera and its faults; a bare list is read as the faults alone."""

    camera: CameraChanges = CameraChanges()
    faults: list[Fault] = []

    def applied(self, settings: SimSettings) -> SimSettings:
        """Settings with what the script says of the camera."""
        changes = {
            name: value
            for name in CameraChanges.__struct_fields__
            if (value := getattr(self.camera, name)) is not UNSET
        }
        if "role" in changes:
            changes["role"] = Role[str(changes["role"]).upper()]
        return replace(settings, **changes)


def read_script(path: str) -> Script:
    """Read a script: YAML, either ``camera:`` and ``faults:``, or a list of faults.

    Raises
    ------
    SimulationError
        With the path of the culprit.
    """
    try:
        document = parse_yaml(read_text(Path(path)))
        return msgspec.convert({"faults": document} if isinstance(document, list) else document, Script)
    except (OSError, DocumentError, msgspec.ValidationError) as error:
        raise SimulationError(f"{path}: {error}") from error
