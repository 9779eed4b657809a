"""Who may do what on the simulated camera: digest and basic authentication, throttle, roles. Pure, explicit time.

Challenges have the form of recorded ones; nonces are built like those of Apache's mod_auth_digest (time, then a hash).
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import re
import struct
from collections import deque
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum

FAILURES_PER_S = 20
"""Failed logins per second above which the throttle closes (System.PreventDoSAttack, DoSPageCount)."""
BLOCK_S = 10.0
"""How long it stays closed (DoSBlockingPeriod)."""
_FIELD = re.compile(r'(\w+)\s*=\s*(?:"((?:[^"\\]|\\.)*)"|([^\s,]+))')


class Policy(StrEnum):
    """Network.HTTP.AuthenticationPolicy."""

    BASIC = "basic"
    DIGEST = "digest"
    BASIC_DIGEST = "basic_digest"
    RECOMMENDED = "recommended"

    def schemes(self, *, secure: bool) -> tuple[str, ...]:
        """Schemes offered over HTTP or HTTPS."""
        if self is Policy.RECOMMENDED:
            return ("Basic",) if secure else ("Digest",)
        return {Policy.BASIC: ("Basic",), Policy.DIGEST: ("Digest",)}.get(self, ("Digest", "Basic"))


class Role(IntEnum):
    """Groups of users; each may do what the ones below may."""

    VIEWER = 1
    OPERATOR = 2
    ADMINISTRATOR = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class User:
    """One account."""

    name: str
    password: str = field(repr=False)
    role: Role = Role.OPERATOR
    ptz: bool = True
    """The PTZ tick; only viewers can be without."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the gate says: a user, or challenges to send with 401, or blocked (403)."""

    user: User | None = None
    challenges: tuple[str, ...] = ()
    blocked: bool = False
    wrong: bool = False
    """Credentials came and were wrong: the camera takes its time to say so."""


class Gate:
    """Checks the Authorization header of each request.

    Parameters
    ----------
    users : tuple of User
    realm : str
        ``AXIS_`` and the serial number.
    policy : Policy
    nonce_life_s : float
        After that a digest is answered with ``stale=true`` and a new nonce.
    basic_first : bool
        Order of the two challenges of ``basic_digest``.
    old_style : bool
        Challenges of firmware 4: no algorithm, ``stale=FALSE``.
    secret : bytes
        Signs the nonces.
    """

    def __init__(
        self,
        users: tuple[User, ...],
        *,
        realm: str,
        policy: Policy = Policy.RECOMMENDED,
        nonce_life_s: float = 300.0,
        basic_first: bool = False,
        old_style: bool = False,
        secret: bytes,
    ) -> None:
        self.policy = policy
        self.nonce_life_s = nonce_life_s
        self._users = {user.name: user for user in users}
        self._realm = realm
        self._basic_first = basic_first
        self._old_style = old_style
        self._secret = secret
        self._failures: deque[float] = deque()
        self._closed_until_s = 0.0

    def forget_nonces(self) -> None:
        """Make every nonce given out so far stale, as a restart of the server does."""
        self._secret = hashlib.sha256(self._secret).digest()

    def shut(self, t_s: float) -> None:
        """Close the door for everybody, as after too many failures."""
        self._closed_until_s = t_s + BLOCK_S

    def appoint(self, name: str, role: Role, *, ptz: bool) -> None:
        """Give an account another role."""
        self._users[name] = replace(self._users[name], role=role, ptz=ptz)

    def check(self, t_s: float, *, method: str, target: str, authorization: str | None, secure: bool) -> Verdict:
        """Judge one request; ``target`` is the raw request target that a digest has signed."""
        if t_s < self._closed_until_s:
            return Verdict(blocked=True)
        schemes = self.policy.schemes(secure=secure)
        scheme, _, rest = (authorization or "").partition(" ")
        offered = scheme.capitalize() in schemes
        if not authorization or not offered:
            return Verdict(challenges=self._challenges(t_s, schemes, stale=False))
        if scheme.lower() == "basic":
            user, stale = self._basic(rest), False
        else:
            user, stale = self._digest(t_s, method, target, rest)
        if user is not None and not stale:
            return Verdict(user=user)
        if not stale:
            self._count_failure(t_s)
        return Verdict(challenges=self._challenges(t_s, schemes, stale=stale), wrong=not stale)

    def refusal(self, t_s: float, *, secure: bool) -> tuple[str, ...]:
        """Challenges as after a wrong password."""
        return self._challenges(t_s, self.policy.schemes(secure=secure), stale=False)

    def _count_failure(self, t_s: float) -> None:
        self._failures.append(t_s)
        while self._failures[0] < t_s - 1.0:
            self._failures.popleft()
        if len(self._failures) > FAILURES_PER_S:
            self.shut(t_s)
            self._failures.clear()

    def _challenges(self, t_s: float, schemes: tuple[str, ...], *, stale: bool) -> tuple[str, ...]:
        lines = {"Basic": f'Basic realm="{self._realm}"', "Digest": self._digest_challenge(t_s, stale=stale)}
        ordered = sorted(schemes, reverse=not self._basic_first)
        return tuple(lines[scheme] for scheme in ordered)

    def _digest_challenge(self, t_s: float, *, stale: bool) -> str:
        nonce = self.nonce(t_s)
        if self._old_style:
            return f'Digest realm="{self._realm}", nonce="{nonce}", stale={str(stale).upper()}, qop="auth"'
        tail = ", stale=true" if stale else ""
        return f'Digest realm="{self._realm}", nonce="{nonce}", algorithm=MD5{tail}, qop="auth"'

    def nonce(self, t_s: float) -> str:
        """Nonce issued at ``t_s``."""
        stamp = base64.b64encode(struct.pack("<q", int(t_s * 1e6))).decode()
        return stamp + hmac.new(self._secret, stamp.encode(), hashlib.sha1).hexdigest()

    def _nonce_fresh(self, t_s: float, nonce: str) -> bool:
        stamp, signature = nonce[:12], nonce[12:]
        expected = hmac.new(self._secret, stamp.encode(), hashlib.sha1).hexdigest()
        if not hmac.compare_digest(expected.encode(), signature.encode()):
            return False
        issued_s = struct.unpack("<q", base64.b64decode(stamp))[0] / 1e6
        return bool(t_s - issued_s <= self.nonce_life_s)

    def _basic(self, rest: str) -> User | None:
        try:
            name, _, password = base64.b64decode(rest, validate=True).decode().partition(":")
        except (binascii.Error, UnicodeDecodeError):
            return None
        user = self._users.get(name)
        return user if user and hmac.compare_digest(user.password.encode(), password.encode()) else None

    def _digest(self, t_s: float, method: str, target: str, rest: str) -> tuple[User | None, bool]:
        """User whose password the digest proves, if any, and whether its nonce is stale."""
        fields = {key.lower(): quoted or plain for key, quoted, plain in _FIELD.findall(rest)}
        user = self._users.get(fields.get("username", ""))
        if user is None or fields.get("realm") != self._realm or not _same_target(fields.get("uri", ""), target):
            return None, False
        if not hmac.compare_digest(_response(user, method, fields).encode(), fields.get("response", "").encode()):
            return None, False
        return user, not self._nonce_fresh(t_s, fields.get("nonce", ""))


def _same_target(uri: str, target: str) -> bool:
    without_origin = re.sub(r"^https?://[^/]+", "", uri)
    return without_origin == target


def _response(user: User, method: str, fields: dict[str, str]) -> str:
    """RFC 2617 §3.2.2.1 with MD5, with and without qop."""
    ha1 = _md5(f"{user.name}:{fields['realm']}:{user.password}")
    ha2 = _md5(f"{method}:{fields['uri']}")
    nonce = fields.get("nonce", "")
    if fields.get("qop") == "auth":
        return _md5(f"{ha1}:{nonce}:{fields.get('nc', '')}:{fields.get('cnonce', '')}:auth:{ha2}")
    return _md5(f"{ha1}:{nonce}:{ha2}")


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
