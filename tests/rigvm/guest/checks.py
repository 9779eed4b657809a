"""Counting what holds, and the software camera's remote control."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path


class Checks:
    """Says and counts every claim; a failed one does not stop the next."""

    def __init__(self) -> None:
        self.passed = 0
        self.failed = 0

    def that(self, claim: str, holds: object, seen: object = "") -> bool:
        good = bool(holds)
        self.passed += good
        self.failed += not good
        print(f"{'ok  ' if good else 'FAIL'} {claim}" + (f"   [{seen}]" if seen != "" else ""), flush=True)
        return good

    def until(self, claim: str, holds: Callable[[], object], limit_s: float = 60.0) -> bool:
        """A claim that becomes true in time."""
        begin_s = time.monotonic()
        while not (good := bool(holds())) and time.monotonic() - begin_s < limit_s:
            time.sleep(0.2)
        return self.that(claim, good, f"{time.monotonic() - begin_s:.1f} s")


def shell(command: str, limit_s: float = 120.0) -> str:
    """What a command printed; its failure is an answer too."""
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, timeout=limit_s, check=False)
    return (done.stdout + done.stderr).strip()


class UvcCamera:
    """The software camera as a process."""

    def __init__(self, pictures: Path, size: str, fps: int) -> None:
        self._arguments = [str(pictures), size, str(fps)]
        self._address = f"/run/uvc-{time.monotonic_ns()}.sock"

    @contextmanager
    def plugged_in(self):
        script = Path(__file__).with_name("uvc_camera.py")
        with subprocess.Popen([sys.executable, script, *self._arguments, self._address]) as process:
            try:
                while not Path(self._address).exists():
                    time.sleep(0.05)
                yield self
            finally:
                self.tell("detach")
                process.terminate()

    def tell(self, command: str) -> int:
        """Give a command and wait until it is obeyed; how many pictures the camera has sent so far."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
            line.bind("")
            line.settimeout(120)
            line.connect(self._address)
            line.send(command.encode())
            return int(line.recv(16))

    def sent(self) -> int:
        """Pictures that went down the cable whole, since the camera was made."""
        return self.tell("count")
