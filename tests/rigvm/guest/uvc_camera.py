"""A USB video camera in software, plugged into the kernel's own uvcvideo driver through vhci-hcd (USB/IP).

Shows the JPEG files of a folder in turn. Needs root and the modules vhci-hcd and uvcvideo. Commands come as words on a
datagram socket: stall, resume, drop N, truncate N, fault N, detach, attach, count. Each is answered with the number of
pictures sent so far.

usage: uvc_camera.py FOLDER WIDTHxHEIGHT FPS SOCKET
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector

from uvc_descriptors import (
    CAMERA,
    PAYLOAD_BYTES,
    PROCESSING,
    STANDARD_CONFIGURATION,
    STANDARD_DEVICE,
    STANDARD_STRING,
    Mode,
    configuration_descriptor,
    device_descriptor,
    string_descriptor,
)

VHCI = Path("/sys/devices/platform/vhci_hcd.0")
PORT, DEVICE_ID, HIGH_SPEED = 0, 65537, 3

SUBMIT, UNLINK, RETURN_SUBMIT, RETURN_UNLINK = 1, 2, 3, 4
GET_CUR, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF = 0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87
CLASS_OUT, CLASS_IN = 0x21, 0xA1
READABLE_AND_SETTABLE = b"\x03"

END_OF_HEADER, ERROR, END_OF_FRAME = 0x80, 0x40, 0x02


@dataclass
class Control:
    """A camera control as UVC knows it."""

    value: int
    low: int
    high: int
    step: int
    default: int
    size: int

    def read(self, request: int) -> bytes:
        if request == GET_INFO:
            return READABLE_AND_SETTABLE
        if request == GET_LEN:
            return self.size.to_bytes(2, "little")
        number = {
            GET_CUR: self.value,
            GET_MIN: self.low,
            GET_MAX: self.high,
            GET_RES: self.step,
            GET_DEF: self.default,
        }[request]
        return number.to_bytes(self.size, "little")


class Function:
    """What the camera answers to requests on its control endpoint."""

    def __init__(self, mode: Mode) -> None:
        self._mode = mode
        self._controls = {
            (CAMERA, 2): Control(value=8, low=1, high=15, step=9, default=8, size=1),
            (CAMERA, 4): Control(value=333, low=1, high=10_000, step=1, default=333, size=4),
            (PROCESSING, 2): Control(value=128, low=0, high=255, step=1, default=128, size=2),
            (PROCESSING, 4): Control(value=10, low=0, high=100, step=1, default=10, size=2),
        }

    def answer(self, setup: bytes, data: bytes) -> bytes | None:
        """Bytes to return (none for a request that only sends); None refuses."""
        kind, request, value, index, length = struct.unpack("<BBHHH", setup)
        if kind == 0x80 and request == 6:
            described = self._describe(value >> 8, value & 0xFF)
            return None if described is None else described[:length]
        if kind == 0x80:
            return bytes(length)
        if kind in (0, 1, 2):
            return b""
        if index & 0xFF == 1:
            return self._negotiate(kind, request)[:length]
        return self._control(kind, request, self._controls.get((index >> 8, value >> 8)), data)

    def _describe(self, kind: int, index: int) -> bytes | None:
        if kind == STANDARD_DEVICE:
            return device_descriptor()
        if kind == STANDARD_CONFIGURATION:
            return configuration_descriptor(self._mode)
        return string_descriptor(index) if kind == STANDARD_STRING else None

    def _negotiate(self, kind: int, request: int) -> bytes:
        if kind == CLASS_OUT:
            return b""
        probe = self._mode.probe()
        return {GET_INFO: READABLE_AND_SETTABLE, GET_LEN: len(probe).to_bytes(2, "little")}.get(request, probe)

    @staticmethod
    def _control(kind: int, request: int, control: Control | None, data: bytes) -> bytes | None:
        if control is None:
            return None
        if kind == CLASS_OUT:
            control.value = int.from_bytes(data, "little")
            return b""
        return control.read(request)


class Cable:
    """The USB/IP connection to the kernel's virtual host controller."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        for end in (ours, theirs):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        with theirs:
            (VHCI / "attach").write_text(f"{PORT} {theirs.fileno()} {DEVICE_ID} {HIGH_SPEED}")
        self.socket = ours

    def pull(self) -> None:
        try:
            (VHCI / "detach").write_text(str(PORT))
        finally:
            self.socket.close()

    def receive(self, count: int) -> bytes:
        received = bytearray()
        while len(received) < count:
            chunk = self.socket.recv(count - len(received))
            if not chunk:
                raise EOFError("the kernel closed the cable")
            received += chunk
        return bytes(received)

    def complete(self, number: int, *, status: int = 0, data: bytes = b"", sent: int | None = None) -> None:
        header = struct.pack(">IIIII", RETURN_SUBMIT, number, DEVICE_ID, 0, 0)
        body = struct.pack(">iiiii8x", status, len(data) if sent is None else sent, 0, 0, 0)
        self.socket.sendall(header + body + data)

    def unlinked(self, number: int, *, found: bool) -> None:
        header = struct.pack(">IIIII", RETURN_UNLINK, number, DEVICE_ID, 0, 0)
        self.socket.sendall(header + struct.pack(">i24x", -errno.ECONNRESET if found else 0))


class Camera:
    """The camera: takes pictures at its rate and misbehaves on command."""

    def __init__(self, pictures: list[bytes], mode: Mode) -> None:
        self.cable: Cable | None = None
        self.sent = 0
        self._function = Function(mode)
        self._pictures = pictures
        self._waiting: list[tuple[int, int]] = []
        self._sending: bytes | None = None
        self._frame_id = 0
        self._ticks = 0
        self._stalled = False
        self._spoil = {"drop": 0, "truncate": 0, "fault": 0}
        self._faulty = False

    def obey(self, words: list[str]) -> None:
        verb = words[0]
        if verb in self._spoil:
            self._spoil[verb] += int(words[1])
        elif verb in ("stall", "resume"):
            self._stalled = verb == "stall"
        elif verb == "attach" and self.cable is None:
            self._waiting, self._sending = [], None
            self.cable = Cable()
        elif verb == "detach" and self.cable is not None:
            cable, self.cable = self.cable, None
            cable.pull()

    def serve(self, cable: Cable) -> None:
        """Handle one message of the kernel."""
        header = cable.receive(48)
        command, number, _, to_host, endpoint = struct.unpack(">IIIII", header[:20])
        if command == UNLINK:
            (other,) = struct.unpack(">I", header[20:24])
            found = any(waiting == other for waiting, _ in self._waiting)
            self._waiting = [item for item in self._waiting if item[0] != other]
            if not self._waiting:
                self._sending = None
            cable.unlinked(number, found=found)
            return
        _, length = struct.unpack(">Ii", header[20:28])
        data = b"" if to_host or length <= 0 else cable.receive(length)
        if endpoint:
            self._waiting.append((number, length))
            self._send(cable)
            return
        answer = self._function.answer(header[40:48], data)
        if answer is None:
            cable.complete(number, status=-errno.EPIPE)
        else:
            cable.complete(number, data=answer if to_host else b"", sent=None if to_host else length)

    def tick(self) -> None:
        """Take a picture, if somebody is there to see it."""
        self._ticks += 1
        if self._stalled or self.cable is None or self._spent("drop") or not self._waiting or self._sending is not None:
            return
        picture = self._pictures[self._ticks % len(self._pictures)]
        if self._spent("truncate"):
            picture = picture[: len(picture) // 2]
        self._faulty = self._spent("fault")
        self._sending = picture
        self._frame_id ^= 1
        self._send(self.cable)

    def _spent(self, kind: str) -> bool:
        spend = self._spoil[kind] > 0
        self._spoil[kind] -= spend
        return spend

    def _send(self, cable: Cable) -> None:
        while self._sending is not None and self._waiting:
            number, room = self._waiting.pop(0)
            room = min(room, PAYLOAD_BYTES) - 2
            part, rest = self._sending[:room], self._sending[room:]
            flags = END_OF_HEADER | self._frame_id | (0 if rest else END_OF_FRAME) | (ERROR if self._faulty else 0)
            cable.complete(number, data=bytes([2, flags]) + part)
            self._sending = rest or None
            self.sent += not rest


def run(camera: Camera, mode: Mode, commands: socket.socket) -> None:
    next_s = time.monotonic()
    while True:
        with DefaultSelector() as selector:
            selector.register(commands, EVENT_READ)
            if camera.cable is not None:
                selector.register(camera.cable.socket, EVENT_READ)
            ready = {key.fileobj for key, _ in selector.select(max(0.0, next_s - time.monotonic()))}
        if camera.cable is not None and camera.cable.socket in ready:
            try:
                camera.serve(camera.cable)
            except (EOFError, OSError) as error:
                print("cable:", error, flush=True)
                camera.cable = None
        if commands in ready:
            words, sender = commands.recvfrom(200)
            camera.obey(words.decode().split())
            commands.sendto(str(camera.sent).encode(), sender)
        if time.monotonic() >= next_s:
            camera.tick()
            next_s = max(next_s, time.monotonic()) + 1 / mode.fps


def main(folder: str, size: str, fps: str, address: str) -> None:
    width, height = map(int, size.split("x"))
    mode = Mode(width=width, height=height, fps=int(fps))
    pictures = [path.read_bytes() for path in sorted(Path(folder).glob("*.jpg"))]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as commands:
        commands.bind(address)
        camera = Camera(pictures, mode)
        camera.obey(["attach"])
        run(camera, mode, commands)


if __name__ == "__main__":
    main(*sys.argv[1:])
