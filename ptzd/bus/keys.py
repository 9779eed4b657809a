"""The key expressions under ``<prefix>/<rig>``."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ptzd.errors import RequestRefused

IMAGE_KEYS = ("image/fisheye", "image/ptz", "image/overlay")
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_PREFIX = re.compile(r"[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+)*")
ANY_RIG = "*"


@dataclass(frozen=True, slots=True)
class Keys:
    """Builds and takes apart the keys of one rig.

    Parameters
    ----------
    prefix : str
        One or more key chunks, e.g. ``ptzd``.
    rig : str
        One chunk; ``*`` for all rigs.

    Raises
    ------
    RequestRefused
        For a prefix or a rig that would make another key than it says, or none at all.
    """

    prefix: str
    rig: str

    def __post_init__(self) -> None:
        if _PREFIX.fullmatch(self.prefix) is None:
            message = f"prefix {self.prefix!r}: must be one or more parts of A-Z a-z 0-9 . _ - with / between them"
            raise RequestRefused("invalid", message, "prefix")
        if self.rig != ANY_RIG and not is_id(self.rig):
            message = f"rig {self.rig!r}: a name is 1 to 64 of A-Z a-z 0-9 . _ -; `ptzd ls` lists the rigs alive"
            raise RequestRefused("invalid", message, "rig")

    def full(self, key: str) -> str:
        """Full key of a key below the rig, e.g. ``status``."""
        return f"{self.prefix}/{self.rig}/{key}"

    def of_request(self, request_id: str, leaf: str) -> str:
        """Full key of ``feedback``, ``result``, ``cancel`` or ``update`` of one request.

        Raises
        ------
        RequestRefused
            When the id is none.
        """
        check_id(request_id)
        return self.full(f"roi/{request_id}/{leaf}")

    def of_all_requests(self, leaf: str) -> str:
        """Key expression of ``feedback``, ``result``, ``cancel`` or ``update`` of every request."""
        return self.full(f"roi/*/{leaf}")

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


def check_id(text: str) -> None:
    """Refuse what :func:`is_id` denies.

    Raises
    ------
    RequestRefused
        With the text, made printable.
    """
    if not is_id(text):
        raise RequestRefused("invalid", f"{text[:80]!r}: an id is 1 to 64 of A-Z a-z 0-9 . _ -", "$.id")
