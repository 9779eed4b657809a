"""``foxglove.CompressedImage`` in protobuf's wire format, without protobuf: four fields around the camera's own bytes.

Field numbers and types are those of Foxglove's ``CompressedImage.proto``: timestamp = 1
(``google.protobuf.Timestamp``), data = 2, format = 3, frame_id = 4.
"""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.errors import LogError

_VARINT, _LENGTH = 0, 2
_STRING, _MESSAGE, _BYTES, _INT32, _INT64 = 9, 11, 12, 5, 3
NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CompressedImage:
    """A picture as the log holds it."""

    t_ns: int
    """Middle of the exposure, ns since the epoch."""
    frame_id: str
    data: bytes
    format: str


def encode_image(image: CompressedImage) -> bytes:
    """Serialise a ``foxglove.CompressedImage``."""
    stamp = _number(1, image.t_ns // NS) + _number(2, image.t_ns % NS)
    head = _text(4, image.frame_id) + _field(1, stamp) + _text(3, image.format)
    return b"".join((head, _key(2, _LENGTH), _varint(len(image.data)), image.data))


def decode_image(message: bytes) -> CompressedImage:
    """Read a ``foxglove.CompressedImage``; unknown fields are skipped.

    Raises
    ------
    LogError
        The bytes are no such message.
    """
    fields = _fields(message)
    stamp = _fields(_bytes(fields.get(1, b"")))
    try:
        return CompressedImage(
            t_ns=_int(stamp.get(1, 0)) * NS + _int(stamp.get(2, 0)),
            frame_id=_bytes(fields.get(4, b"")).decode(),
            data=_bytes(fields.get(2, b"")),
            format=_bytes(fields.get(3, b"")).decode(),
        )
    except UnicodeDecodeError as error:
        raise LogError(f"picture message: a text is not UTF-8: {error}") from None


def compressed_image_descriptor() -> bytes:
    """Serialised ``FileDescriptorSet`` with ``foxglove.CompressedImage`` and the ``Timestamp`` it uses."""
    stamp = _message("Timestamp", (("seconds", 1, _INT64, ""), ("nanos", 2, _INT32, "")))
    image = _message(
        "CompressedImage",
        (
            ("timestamp", 1, _MESSAGE, ".google.protobuf.Timestamp"),
            ("frame_id", 4, _STRING, ""),
            ("data", 2, _BYTES, ""),
            ("format", 3, _STRING, ""),
        ),
    )
    stamp_file = _file("google/protobuf/timestamp.proto", "google.protobuf", (), stamp)
    image_file = _file("foxglove/CompressedImage.proto", "foxglove", ("google/protobuf/timestamp.proto",), image)
    return _field(1, stamp_file) + _field(1, image_file)


def _file(name: str, package: str, imports: tuple[str, ...], message: bytes) -> bytes:
    """``FileDescriptorProto``: name = 1, package = 2, dependency = 3, message_type = 4, syntax = 12."""
    head = _text(1, name) + _text(2, package) + b"".join(_text(3, path) for path in imports)
    return head + _field(4, message) + _text(12, "proto3")


def _message(name: str, fields: tuple[tuple[str, int, int, str], ...]) -> bytes:
    """``DescriptorProto``: name = 1, field = 2 (name = 1, number = 3, label = 4, type = 5, type_name = 6)."""
    described = b""
    for field, number, kind, type_name in fields:
        body = _text(1, field) + _number(3, number) + _number(4, 1) + _number(5, kind)
        described += _field(2, body + (_text(6, type_name) if type_name else b""))
    return _text(1, name) + described


def _key(number: int, wire: int) -> bytes:
    return _varint(number << 3 | wire)


def _number(number: int, value: int) -> bytes:
    return _key(number, _VARINT) + _varint(value)


def _text(number: int, value: str) -> bytes:
    return _field(number, value.encode())


def _field(number: int, payload: bytes) -> bytes:
    return _key(number, _LENGTH) + _varint(len(payload)) + payload


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for step in range(10):
        if at + step >= len(data):
            break
        value |= (data[at + step] & 0x7F) << (7 * step)
        if data[at + step] < 0x80:
            return value, at + step + 1
    raise LogError(f"picture message: no number at byte {at}")


def _fields(data: bytes) -> dict[int, int | bytes]:
    """Last value of every field; wire types of fixed length are skipped."""
    found: dict[int, int | bytes] = {}
    at = 0
    while at < len(data):
        key, at = _read_varint(data, at)
        wire = key & 7
        if wire == _VARINT:
            found[key >> 3], at = _read_varint(data, at)
            continue
        if wire == _LENGTH:
            length, at = _read_varint(data, at)
            found[key >> 3] = data[at : at + length]
        elif wire in {1, 5}:
            length = 8 if wire == 1 else 4
        else:
            raise LogError(f"picture message: wire type {wire} at byte {at}")
        at += length
        if at > len(data):
            raise LogError(f"picture message: a field ends {at - len(data)} bytes behind the end")
    return found


def _int(value: int | bytes) -> int:
    if not isinstance(value, int):
        raise LogError("picture message: a number is missing")
    return value


def _bytes(value: int | bytes) -> bytes:
    if not isinstance(value, bytes):
        raise LogError("picture message: bytes are missing")
    return value
