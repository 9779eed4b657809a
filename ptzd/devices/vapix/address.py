"""Where a camera is and by what it is recognised."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass

import aiohttp
from yarl import URL

from ptzd.errors import ConfigError

LONGEST_HOST = 253
FORM = "give http://host[:port] or https://host[:port]"


_LABEL = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")
"""RFC 1123, and the underscore that many a local network has in its names."""


def is_usable(url: URL) -> bool:
    """Whether a web server can be there: http or https, a port, and a host that is an IP address or could be a name."""
    if url.scheme not in {"http", "https"} or not url.raw_host or not url.port:
        return False
    try:
        ipaddress.ip_address(url.raw_host)
    except ValueError:
        labels = url.raw_host.removesuffix(".").split(".")
        # a name's last part is no number: 1.2.3.4.5 and 300.1.1.1 are IP addresses mistyped
        named = all(_LABEL.fullmatch(label) for label in labels) and not labels[-1].isdigit()
        return named and len(url.raw_host) <= LONGEST_HOST
    return True


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
            Not http or https, no host or none that can be, or with credentials inside.
        """
        name = f"{self.setting}.url"
        try:
            url = URL(self.url)
        except ValueError:
            raise ConfigError(f"{name}: not a URL; {FORM}") from None
        if url.user is not None or url.password is not None:
            raise ConfigError(f"{name}: holds a user or a password; use {self.setting}.user and password_file")
        if not is_usable(url):
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
