"""A self-signed TLS certificate made on the spot: ECDSA on P-256, X.509 v3, nothing but integers and DER.

Each start has its own key, as each camera has; the key guards nothing but a simulation.
"""

from __future__ import annotations

import base64
import hashlib
import secrets
import ssl
import tempfile
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

_P = 2**256 - 2**224 + 2**192 + 2**96 - 1
_A = _P - 3
_ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
_G = (
    0x6B17D1F2E12C4247F8BCE6E563A440F277037D812DEB33A0F4A13945D898C296,
    0x4FE342E2FE1A7F9B8EE7EB4A7C0F9E162BCE33576B315ECECBB6406837BF51F5,
)
_Point = tuple[int, int] | None

_OID_EC_KEY = "2a8648ce3d0201"
_OID_P256 = "2a8648ce3d030107"
_OID_ECDSA_SHA256 = "2a8648ce3d040302"
_OID_COMMON_NAME = "550403"
_OID_SUBJECT_ALT_NAME = "551d11"


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """A certificate with its key."""

    der: bytes
    key_der: bytes = field(repr=False)

    @property
    def sha256(self) -> str:
        """Fingerprint, hex."""
        return hashlib.sha256(self.der).hexdigest()

    @property
    def pem(self) -> str:
        """The certificate as PEM."""
        return _pem("CERTIFICATE", self.der)

    def server_context(self) -> ssl.SSLContext:
        """TLS context of a server with this certificate."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        with tempfile.TemporaryDirectory(prefix="ptzd-sim-") as folder:
            path = Path(folder) / "server.pem"
            path.touch(mode=0o600)
            path.write_text(_pem("EC PRIVATE KEY", self.key_der) + self.pem)
            context.load_cert_chain(path)
        return context


def self_signed(common_name: str, address: str = "127.0.0.1") -> Certificate:
    """Certificate for a name and an IPv4 address, valid from yesterday for ten years."""
    private = secrets.randbelow(_ORDER - 1) + 1
    public = _point_bytes(_multiply(private, _G))
    body = _body(common_name, address, public)
    signature = _sign(private, body)
    der = _sequence(body, _sequence(_oid(_OID_ECDSA_SHA256)), _bits(signature))
    curve = _der(0xA0, _oid(_OID_P256))
    key = _sequence(_integer(1), _der(0x04, private.to_bytes(32)), curve, _der(0xA1, _bits(public)))
    return Certificate(der=der, key_der=key)


def _body(common_name: str, address: str, public: bytes) -> bytes:
    name = _sequence(_der(0x31, _sequence(_oid(_OID_COMMON_NAME), _der(0x0C, common_name.encode()))))
    start = datetime.now(UTC) - timedelta(days=1)
    validity = _sequence(_time(start), _time(start + timedelta(days=3650)))
    key = _sequence(_sequence(_oid(_OID_EC_KEY), _oid(_OID_P256)), _bits(public))
    octets = bytes(int(part) for part in address.split("."))
    names = _sequence(_der(0x87, octets), _der(0x82, b"localhost"))
    extensions = _sequence(_sequence(_oid(_OID_SUBJECT_ALT_NAME), _der(0x04, names)))
    serial = _integer(secrets.randbits(63) + 1)
    algorithm = _sequence(_oid(_OID_ECDSA_SHA256))
    version = _der(0xA0, _integer(2))
    return _sequence(version, serial, algorithm, name, validity, name, key, _der(0xA3, extensions))


def _sign(private: int, message: bytes) -> bytes:
    """ECDSA signature of the SHA-256 of a message (FIPS 186-4 §6.4), DER."""
    digest = int.from_bytes(hashlib.sha256(message).digest())
    while True:
        nonce = secrets.randbelow(_ORDER - 1) + 1
        point = _multiply(nonce, _G)
        r = point[0] % _ORDER if point else 0
        s = pow(nonce, -1, _ORDER) * (digest + r * private) % _ORDER
        if r and s:
            return _sequence(_integer(r), _integer(s))


def _multiply(scalar: int, point: _Point) -> _Point:
    total: _Point = None
    while scalar:
        if scalar & 1:
            total = _add(total, point)
        point = _add(point, point)
        scalar >>= 1
    return total


def _add(left: _Point, right: _Point) -> _Point:
    if left is None or right is None:
        return left or right
    (x1, y1), (x2, y2) = left, right
    if x1 == x2 and (y1 + y2) % _P == 0:
        return None
    slope = (3 * x1 * x1 + _A) * pow(2 * y1, -1, _P) if left == right else (y2 - y1) * pow(x2 - x1, -1, _P)
    x = (slope * slope - x1 - x2) % _P
    return x, (slope * (x1 - x) - y1) % _P


def _point_bytes(point: _Point) -> bytes:
    if point is None:
        raise ValueError("the point at infinity is no public key")
    return b"\x04" + point[0].to_bytes(32) + point[1].to_bytes(32)


def _der(tag: int, content: bytes) -> bytes:
    length = len(content)
    if length < 0x80:
        return bytes([tag, length]) + content
    size = length.to_bytes((length.bit_length() + 7) // 8)
    return bytes([tag, 0x80 | len(size)]) + size + content


def _sequence(*parts: bytes) -> bytes:
    return _der(0x30, b"".join(parts))


def _integer(value: int) -> bytes:
    return _der(0x02, value.to_bytes(value.bit_length() // 8 + 1))


def _bits(content: bytes) -> bytes:
    return _der(0x03, b"\x00" + content)


def _oid(encoded: str) -> bytes:
    return _der(0x06, bytes.fromhex(encoded))


def _time(moment: datetime) -> bytes:
    return _der(0x17, moment.strftime("%y%m%d%H%M%SZ").encode())


def _pem(kind: str, der: bytes) -> str:
    text = base64.b64encode(der).decode()
    rows = [text[start : start + 64] for start in range(0, len(text), 64)]
    return "\n".join([f"-----BEGIN {kind}-----", *rows, f"-----END {kind}-----", ""])
