"""The key expressions under ``<prefix>/<rig>``."""

from __future__ import annotations

import re
from dataclasses import dataclass

IMAGE_KEYS = ("image/fisheye", "image/ptz", "image/overlay")
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass(frozen=True, slots=True)
class Keys:
    """Builds and takes apart the keys of one rig.

    Parameters
    ----------
    prefix : str
        One or more key chunks, e.g. ``ptzd``.
    rig : str
        One chunk; ``*`` for all rigs.
    """

    prefix: str
    rig: str

    def full(self, key: str) -> str:
        """Full key of a key below the rig, e.g. ``status``."""
        return f"{self.prefix}/{self.rig}/{key}"

    def of_request(self, request_id: str, leaf: str) -> str:
        """Full key of ``feedback``, ``result``, ``cancel`` or ``update`` of one request (``*`` for all)."""
        return self.full(f"roi/{request_id}/{leaf}")

    def rig_of(self, full_key: str) -> str:
        """Name of the rig that a full key belongs to."""
        return full_key.removeprefix(f"{self.prefix}/").partition("/")[0]


def request_id_of(full_key: str, leaf: str) -> str | None:
    """Id in ``…/roi/<id>/<leaf>``; None when the key ends otherwise or names no single legal id."""
    chunks = full_key.split("/")
    if len(chunks) < 3 or chunks[-3] != "roi" or chunks[-1] != leaf or not _ID.fullmatch(chunks[-2]):
        return None
    return chunks[-2]


def is_id(text: str) -> bool:
    """Whether a text may name a request: 1 to 64 of ``A-Za-z0-9._-``."""
    return _ID.fullmatch(text) is not None
