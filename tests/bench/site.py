"""A simulated rig and a daemon on it, each a process of its own, for benches that load, starve and break them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

RIG = "demo"
ROOT = Path(__file__).parents[2]
"""From where the benches start themselves as processes."""
PATIENCE_S = 60.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class LiveRig:
    """Use as a context manager; both processes are ended by their ids, the daemon first."""

    def __init__(self, folder: Path, *, profile: str = "v5915", settings: dict[str, Any] | None = None) -> None:
        self.folder = folder
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.config = folder / "ptzd.yaml"
        self.truth = ""
        self._profile = profile
        self._settings = settings or {}
        self._simulator: subprocess.Popen[str] | None = None
        self.daemon: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        ports = [str(free_port()) for _ in range(3)]
        command = [
            sys.executable, "-m", "ptzd", "sim", "--json", "--port", ports[0], "--fisheye-port", ports[1],
            "--truth-port", ports[2], "--write-config", str(self.folder), "--bus", self.endpoint,
        ]  # fmt: skip
        self._simulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._simulator.stdout is not None
        facts = json.loads(self._simulator.stdout.readline())
        self.truth = facts["truth_url"]
        document = yaml.safe_load(self.config.read_text())
        for part, values in self._settings.items():
            document[part] = {**document.get(part, {}), **values}
        self.config.write_text(yaml.safe_dump(document))
        self.start_daemon()
        return self

    def start_daemon(self) -> None:
        journal = (self.folder / "journal.txt").open("a")
        command = [sys.executable, "-m", "ptzd", "run", "--config", str(self.config)]
        self.daemon = subprocess.Popen(command, stdout=journal, stderr=journal, text=True)
        journal.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in (self.daemon, self._simulator):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        if self._simulator is not None and self._simulator.stdout is not None:
            self._simulator.stdout.close()

    def stop_daemon(self) -> int:
        """End it as a service manager would; returns its exit status."""
        assert self.daemon is not None
        self.daemon.send_signal(signal.SIGTERM)
        return self.daemon.wait(PATIENCE_S)

    @property
    def resident_kib(self) -> int:
        """Resident memory of the daemon; 0 when it is not there."""
        assert self.daemon is not None
        try:
            pages = int(Path(f"/proc/{self.daemon.pid}/statm").read_text().split()[1])
        except OSError:
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE") // 1024

    def ask_truth(self, path: str, document: object | None = None, method: str | None = None) -> Any:
        """One question to the simulator's side channel, or a fault for it."""
        data = None if document is None else json.dumps(document).encode()
        request = urllib.request.Request(self.truth + path, data, {"Content-Type": "application/json"}, method=method)
        with urllib.request.urlopen(request, timeout=10) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def monotonic_from_sim_ns(self) -> int:
        """What to add to the simulator's times to get this machine's monotonic clock."""
        pose = self.ask_truth("/truth/pose")
        return int(pose["monotonic_ns"]) - int(pose["t_ns"])

    def stop_seen_ns(self, after_ns: int, patience_s: float = 10.0) -> int | None:
        """When the camera took the first stop after a moment, both on the monotonic clock."""
        offset_ns = self.monotonic_from_sim_ns()
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline:
            for order in self.ask_truth("/truth/orders")["orders"]:
                stops = order["kind"] == "Turn" and order["pan_percent"] == order["tilt_percent"] == 0
                if stops and order["t_ns"] + offset_ns >= after_ns:
                    return int(order["t_ns"]) + offset_ns
            time.sleep(0.05)
        return None
