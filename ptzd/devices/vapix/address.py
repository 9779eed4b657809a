"""Where a camera is and by what it is recognised."""

from __future__ import annotations

from dataclasses import dataclass

import aiohttp
from yarl import URL

from ptzd.errors import ConfigError

FORM = "give http://host[:port] or https://host[:port]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where a camera is and how it is trusted."""

    url: str
    setting: str
    """Part of the settings, for messages, e.g. ``ptz``."""
    allow_basic_over_http: bool = False
    certificate_sha256: str | None = None
    """Hex; the certificate to insist on, whoever signed it."""

    def base(self) -> URL:
        """The URL, checked.

        Raises
        ------
        ConfigError
            Not http or https, no host, or with credentials inside.
        """
        name = f"{self.setting}.url"
        try:
            url = URL(self.url)
        except ValueError:
            raise ConfigError(f"{name}: not a URL; {FORM}") from None
        if url.user is not None or url.password is not None:
            raise ConfigError(f"{name}: holds a user or a password; use {self.setting}.user and password_file")
        if url.scheme not in {"http", "https"} or not url.host:
            raise ConfigError(f"{name}: {self.url!r} cannot be used; {FORM}")
        return url

    def fingerprint(self) -> aiohttp.Fingerprint | None:
        """The certificate's digest as aiohttp wants it."""
        if self.certificate_sha256 is None:
            return None
        try:
            return aiohttp.Fingerprint(bytes.fromhex(self.certificate_sha256.replace(":", "")))
        except ValueError:
            raise ConfigError(f"{self.setting}.certificate_sha256: needs 64 hex digits, colons allowed") from None
