"""HTTP authentication by the server's challenges: Digest (RFC 7616, RFC 2069), else Basic (RFC 7617). Sans-IO.

One :class:`Authenticator` serves all connections to a camera, so polls and streams share a nonce and its counter.
A password is tried once per nonce: a refusal on a nonce that never worked is final, whatever else the server says.
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from ptzd.devices.vapix.credentials import Credentials
from ptzd.errors import DeviceGarbled, DeviceRefused

_HASHES = {"MD5": "md5", "SHA-256": "sha256"}
_PREFERENCE = ("SHA-256", "SHA-256-SESS", "MD5", "MD5-SESS")
_WORD = r"[!#$%&'*+\-.^_`|~0-9A-Za-z]+"
_SCHEME = re.compile(rf"[\s,]*({_WORD})(?:\s+|\s*,|$)")
_PARAMETER = re.compile(rf'[\s,]*({_WORD})\s*=\s*(?:"((?:[^"\\]|\\.)*)"|([^\s,"]*))')


@dataclass(frozen=True, slots=True, kw_only=True)
class Challenge:
    """One way the server offers to authenticate: scheme and parameter names in lower case."""

    scheme: str
    parameters: dict[str, str]

    @property
    def stale(self) -> bool:
        """Whether only the nonce was too old, not the password wrong."""
        return self.parameters.get("stale", "").lower() == "true"

    @property
    def algorithm(self) -> str:
        """Name in upper case; MD5 when the server does not say."""
        return self.parameters.get("algorithm", "MD5").upper()

    @property
    def quality(self) -> str | None:
        """Quality of protection to use: ``auth``, ``""`` for RFC 2069 servers, None when none is supported."""
        offered = self.parameters.get("qop")
        if offered is None:
            return ""
        return "auth" if "auth" in (item.strip().lower() for item in offered.split(",")) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One authorization sent, kept to judge the answer."""

    challenge: Challenge
    value: str = field(repr=False)
    """The ``Authorization`` header."""


def parse_challenges(values: Iterable[str]) -> list[Challenge]:
    """Challenges of all ``WWW-Authenticate`` headers, several in one header included (RFC 9110, 11.6.1)."""
    challenges: list[Challenge] = []
    for value in values:
        at = 0
        while (scheme := _SCHEME.match(value, at)) is not None:
            at = scheme.end()
            parameters: dict[str, str] = {}
            while (found := _PARAMETER.match(value, at)) is not None:
                quoted, bare = found.group(2), found.group(3)
                parameters[found.group(1).lower()] = bare if quoted is None else re.sub(r"\\(.)", r"\1", quoted)
                at = found.end()
            challenges.append(Challenge(scheme=scheme.group(1).lower(), parameters=parameters))
    for challenge in challenges:
        _refuse_undecodable(challenge)
    return challenges


def _refuse_undecodable(challenge: Challenge) -> None:
    """Raise DeviceGarbled for parameters that cannot be given back: they go into a header, which is UTF-8."""
    for name, value in challenge.parameters.items():
        try:
            value.encode()
        except UnicodeEncodeError:
            shown = value.encode("ascii", "backslashreplace").decode()
            raise DeviceGarbled(
                f"asks for {challenge.scheme} authentication with a {name} that is not UTF-8 ({shown}); "
                "give the camera a name and realm of plain letters"
            ) from None


def digest_header(
    credentials: Credentials, challenge: Challenge, *, method: str, target: str, count: int, cnonce: str
) -> str:
    """``Authorization`` value that answers a Digest challenge.

    Parameters
    ----------
    method, target : str
        Request method and the exact request target (path and query as sent).
    count : int
        How often this nonce was used, this time included.
    cnonce : str
        The client's own random text.
    """
    parameters, algorithm, quality = challenge.parameters, challenge.algorithm, challenge.quality
    name = _HASHES[algorithm.removesuffix("-SESS")]
    realm, nonce = parameters.get("realm", ""), parameters["nonce"]

    def digest(*texts: str) -> str:
        return hashlib.new(name, ":".join(texts).encode(), usedforsecurity=False).hexdigest()

    key = digest(credentials.user, realm, credentials.password.reveal())
    if algorithm.endswith("-SESS"):
        key = digest(key, nonce, cnonce)
    middle = (f"{count:08x}", cnonce, quality) if quality else ()
    response = digest(key, nonce, *middle, digest(method, target))
    items = [f'username="{_escaped(credentials.user)}"', f'realm="{_escaped(realm)}"', f'nonce="{_escaped(nonce)}"']
    items += [f'uri="{target}"', f'response="{response}"']
    if "algorithm" in parameters:
        items.append(f"algorithm={parameters['algorithm']}")
    if "opaque" in parameters:
        items.append(f'opaque="{_escaped(parameters["opaque"])}"')
    if quality:
        items.append(f"qop={quality}, nc={count:08x}")
    if quality or algorithm.endswith("-SESS"):
        items.append(f'cnonce="{cnonce}"')
    return "Digest " + ", ".join(items)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


class Authenticator:
    """What is known of how a server wants to be asked.

    Parameters
    ----------
    credentials : Credentials or None
        None when the server is expected to ask for nothing.
    basic_allowed : bool
        Whether the password may be sent as it is: over TLS, or when the settings allow it.
    setting : str
        Part of the settings, for messages.
    cnonce : callable
        Random texts for Digest.
    """

    def __init__(
        self,
        credentials: Credentials | None,
        *,
        basic_allowed: bool,
        setting: str,
        cnonce: Callable[[], str] = lambda: secrets.token_hex(8),
    ) -> None:
        self._credentials = credentials
        self._basic_allowed = basic_allowed
        self._setting = setting
        self._cnonce = cnonce
        self._challenge: Challenge | None = None
        self._count = 0
        self._proven = False
        self._weaker = False
        self.trusted = False
        """Whether any page took this user and password."""

    def attempt(self, method: str, target: str) -> Attempt | None:
        """Authorization for the next request; None while the server has not asked for any."""
        if self._challenge is None or self._credentials is None:
            return None
        if self._challenge.scheme == "basic":
            pair = f"{self._credentials.user}:{self._credentials.password.reveal()}"
            value = "Basic " + base64.b64encode(pair.encode()).decode()
            return Attempt(challenge=self._challenge, value=value)
        self._count += 1
        value = digest_header(
            self._credentials, self._challenge, method=method, target=target, count=self._count, cnonce=self._cnonce()
        )
        return Attempt(challenge=self._challenge, value=value)

    def accepted(self, attempt: Attempt | None) -> None:
        """The server answered anything but 401 to this attempt."""
        if attempt is not None and attempt.challenge is self._challenge:
            self._proven = self.trusted = True

    def challenged(self, attempt: Attempt | None, headers: Iterable[str]) -> None:
        """Take the challenges of a 401; returns when asking again makes sense.

        Raises
        ------
        DeviceRefused
            The password was tried and refused, or nothing that the server offers can be used.
        """
        offered = parse_challenges(headers)
        chosen = self._choose(offered)
        if attempt is not None and attempt.challenge is not self._challenge:
            return  # another request renewed the nonce meanwhile
        if attempt is not None and not self._renews(attempt.challenge, chosen):
            chosen = self._weaker_one(attempt.challenge, offered)
        self._challenge, self._count, self._proven = chosen, 0, False

    def _weaker_one(self, refused: Challenge, offered: list[Challenge]) -> Challenge:
        """MD5 in place of a SHA-256 that the camera offers and refuses, once: some firmware computes it otherwise.

        Raises
        ------
        DeviceRefused
            There is nothing else to try; with what follows from whether another page took the password.
        """
        weaker = [item for item in offered if _usable(item) and item.algorithm.startswith("MD5")]
        if refused.algorithm.startswith("SHA-256") and weaker and not self.trusted and not self._weaker:
            self._weaker = True
            return weaker[0]
        user = "" if self._credentials is None else self._credentials.user
        if self.trusted:
            raise DeviceRefused(
                f"user {user!r} is refused on this page (401) though others take it; give the account the right to it, "
                "or correct the password's file if the password was changed"
            )
        raise DeviceRefused(
            f"user {user!r} or the password is refused (401); correct {self._setting}.user or the password's file"
        )

    def _renews(self, old: Challenge, new: Challenge) -> bool:
        if new.scheme == old.scheme == "basic":
            return False
        return new.stale or self._proven

    def _choose(self, challenges: list[Challenge]) -> Challenge:
        if self._credentials is None:
            raise DeviceRefused(f"asks for a user and a password (401); set {self._setting}.user and its password_file")
        digests = [item for item in challenges if _usable(item)]
        if digests:
            order = _PREFERENCE[2:] + _PREFERENCE[:2] if self._weaker else _PREFERENCE
            return min(digests, key=lambda item: order.index(item.algorithm))
        for item in challenges:
            if item.scheme == "basic":
                if self._basic_allowed:
                    return item
                raise DeviceRefused(
                    "offers only Basic authentication without TLS, which shows the password to anybody on the way; "
                    f"use an https:// URL or set {self._setting}.allow_basic_over_http: true"
                )
        offered = ", ".join(sorted({item.scheme for item in challenges})) or "nothing"
        raise DeviceRefused(f"offers no usable authentication (401 with {offered}); enable Digest in the camera")


def _usable(challenge: Challenge) -> bool:
    return (
        challenge.scheme == "digest"
        and bool(challenge.parameters.get("nonce"))
        and challenge.algorithm in _PREFERENCE
        and challenge.quality is not None
    )
