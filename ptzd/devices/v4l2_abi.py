"""The kernel's video interface as data: structures and request numbers of ``linux/videodev2.h`` that a reader needs.

Layouts are those of 64-bit Linux (little endian, ``long`` of 8 bytes); only single-planar capture with mapped buffers.
Names are the header's own without ``V4L2_``/``VIDIOC_``, so that its documentation applies.
"""

from __future__ import annotations

import ctypes

BUF_TYPE_VIDEO_CAPTURE = 1
MEMORY_MMAP = 1
FIELD_ANY = 0

CAP_VIDEO_CAPTURE = 0x00000001
CAP_STREAMING = 0x04000000
CAP_DEVICE_CAPS = 0x80000000

BUF_FLAG_ERROR = 0x00000040
BUF_FLAG_TIMESTAMP_MASK = 0x0000E000
BUF_FLAG_TIMESTAMP_MONOTONIC = 0x00002000

CTRL_FLAG_DISABLED = 0x0001
CTRL_FLAG_READ_ONLY = 0x0004
CTRL_FLAG_NEXT_CTRL = 0x80000000
CTRL_TYPES_OF_ONE_INTEGER = frozenset({1, 2, 3, 8, 9})
"""Integer, boolean, menu, bit mask, integer menu: what a 32-bit value can set."""

FRMSIZE_TYPE_DISCRETE = 1


class Capability(ctypes.Structure):
    """What a device node is and can do."""

    driver: bytes
    card: bytes
    bus_info: bytes
    version: int
    capabilities: int
    device_caps: int
    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        ("version", ctypes.c_uint32),
        ("capabilities", ctypes.c_uint32),
        ("device_caps", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 3),
    )


class FormatDescription(ctypes.Structure):
    """One pixel format out of those on offer."""

    index: int
    type: int
    flags: int
    description: bytes
    pixelformat: int
    _fields_ = (
        ("index", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("description", ctypes.c_char * 32),
        ("pixelformat", ctypes.c_uint32),
        ("mbus_code", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 3),
    )


class PixelFormat(ctypes.Structure):
    """Size and layout of a picture; lengths in bytes, sizes in px."""

    width: int
    height: int
    pixelformat: int
    field: int
    bytesperline: int
    sizeimage: int
    _fields_ = (
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("pixelformat", ctypes.c_uint32),
        ("field", ctypes.c_uint32),
        ("bytesperline", ctypes.c_uint32),
        ("sizeimage", ctypes.c_uint32),
        ("colorspace", ctypes.c_uint32),
        ("priv", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("ycbcr_enc", ctypes.c_uint32),
        ("quantization", ctypes.c_uint32),
        ("xfer_func", ctypes.c_uint32),
    )


class _FormatUnion(ctypes.Union):
    pix: PixelFormat
    _fields_ = (("pix", PixelFormat), ("raw", ctypes.c_uint64 * 25))


class Format(ctypes.Structure):
    """A format to set, or the one that is set."""

    type: int
    fmt: _FormatUnion
    _fields_ = (("type", ctypes.c_uint32), ("fmt", _FormatUnion))


class Fraction(ctypes.Structure):
    """A time per frame in s."""

    numerator: int
    denominator: int
    _fields_ = (("numerator", ctypes.c_uint32), ("denominator", ctypes.c_uint32))


class SizeRange(ctypes.Structure):
    """Sizes in px; of a discrete one only the first two words are set, as width and height."""

    min_width: int
    max_width: int
    step_width: int
    min_height: int
    max_height: int
    step_height: int
    _fields_ = tuple(
        (name, ctypes.c_uint32)
        for name in ("min_width", "max_width", "step_width", "min_height", "max_height", "step_height")
    )


class FrameSizeEnum(ctypes.Structure):
    """One size (or range of sizes) of a format."""

    index: int
    pixel_format: int
    type: int
    size: SizeRange
    _fields_ = (
        ("index", ctypes.c_uint32),
        ("pixel_format", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("size", SizeRange),
        ("reserved", ctypes.c_uint32 * 2),
    )


class FrameIntervalEnum(ctypes.Structure):
    """One time per frame of a format and size; of a range, ``interval`` is the shortest."""

    index: int
    pixel_format: int
    width: int
    height: int
    type: int
    interval: Fraction
    _fields_ = (
        ("index", ctypes.c_uint32),
        ("pixel_format", ctypes.c_uint32),
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("interval", Fraction),
        ("rest_of_range", Fraction * 2),
        ("reserved", ctypes.c_uint32 * 2),
    )


class StreamParameters(ctypes.Structure):
    """The frame rate."""

    type: int
    capability: int
    timeperframe: Fraction
    _fields_ = (
        ("type", ctypes.c_uint32),
        ("capability", ctypes.c_uint32),
        ("capturemode", ctypes.c_uint32),
        ("timeperframe", Fraction),
        ("rest_of_union", ctypes.c_uint32 * 46),
    )


class RequestBuffers(ctypes.Structure):
    """How many buffers to make; 0 releases them."""

    count: int
    type: int
    memory: int
    _fields_ = (
        ("count", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("memory", ctypes.c_uint32),
        ("capabilities", ctypes.c_uint32),
        ("flags", ctypes.c_uint8),
        ("reserved", ctypes.c_uint8 * 3),
    )


class TimeValue(ctypes.Structure):
    """A time stamp in s and µs."""

    tv_sec: int
    tv_usec: int
    _fields_ = (("tv_sec", ctypes.c_int64), ("tv_usec", ctypes.c_int64))


class _Memory(ctypes.Union):
    offset: int
    _fields_ = (("offset", ctypes.c_uint32), ("userptr", ctypes.c_uint64))


class Buffer(ctypes.Structure):
    """One buffer on its way between the driver and us."""

    index: int
    type: int
    bytesused: int
    flags: int
    field: int
    timestamp: TimeValue
    sequence: int
    memory: int
    m: _Memory
    length: int
    _fields_ = (
        ("index", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("bytesused", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("field", ctypes.c_uint32),
        ("timestamp", TimeValue),
        ("timecode", ctypes.c_uint32 * 4),
        ("sequence", ctypes.c_uint32),
        ("memory", ctypes.c_uint32),
        ("m", _Memory),
        ("length", ctypes.c_uint32),
        ("reserved2", ctypes.c_uint32),
        ("request_fd", ctypes.c_int32),
    )


class ControlQuery(ctypes.Structure):
    """What a control is called and which values it takes."""

    id: int
    type: int
    name: bytes
    minimum: int
    maximum: int
    step: int
    default_value: int
    flags: int
    _fields_ = (
        ("id", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("name", ctypes.c_char * 32),
        ("minimum", ctypes.c_int32),
        ("maximum", ctypes.c_int32),
        ("step", ctypes.c_int32),
        ("default_value", ctypes.c_int32),
        ("flags", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 2),
    )


class Control(ctypes.Structure):
    """The value of a control."""

    id: int
    value: int
    _fields_ = (("id", ctypes.c_uint32), ("value", ctypes.c_int32))


class StreamType(ctypes.Structure):
    """Which of a device's streams to start or stop."""

    type: int
    _fields_ = (("type", ctypes.c_int32),)


_WRITE, _READ = 1, 2


def _request(direction: int, number: int, argument: type[ctypes.Structure]) -> int:
    """Number of a request as ``linux/ioctl.h`` composes it: direction, size of the argument, 'V', number."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


QUERYCAP = _request(_READ, 0, Capability)
ENUM_FMT = _request(_READ | _WRITE, 2, FormatDescription)
S_FMT = _request(_READ | _WRITE, 5, Format)
REQBUFS = _request(_READ | _WRITE, 8, RequestBuffers)
QUERYBUF = _request(_READ | _WRITE, 9, Buffer)
QBUF = _request(_READ | _WRITE, 15, Buffer)
DQBUF = _request(_READ | _WRITE, 17, Buffer)
STREAMON = _request(_WRITE, 18, StreamType)
STREAMOFF = _request(_WRITE, 19, StreamType)
S_PARM = _request(_READ | _WRITE, 22, StreamParameters)
G_CTRL = _request(_READ | _WRITE, 27, Control)
S_CTRL = _request(_READ | _WRITE, 28, Control)
QUERYCTRL = _request(_READ | _WRITE, 36, ControlQuery)
ENUM_FRAMESIZES = _request(_READ | _WRITE, 74, FrameSizeEnum)
ENUM_FRAMEINTERVALS = _request(_READ | _WRITE, 75, FrameIntervalEnum)


def fourcc(code: str) -> int:
    """Number of a four-character format code, e.g. ``MJPG``; a shorter code is filled up with spaces."""
    return int.from_bytes(code.ljust(4).encode("ascii"), "little")


def fourcc_text(number: int) -> str:
    """Four-character code of a format number."""
    return number.to_bytes(4, "little").decode("latin-1").rstrip()
