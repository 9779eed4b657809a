"""Runs in the service's place and writes down what it can reach, into the state directory."""

import json
import os
from pathlib import Path

WRITE = (
    *("/etc/x", "/usr/x", "/root/x", "/mnt/share/x", "/etc/ptzd/x"),
    *("/var/lib/ptzd/x", "/var/log/ptzd/x", "/run/ptzd/x", "/tmp/x"),
)
READ = (
    *("/dev/ttyS0", "/dev/vda", "/dev/mem", "/etc/shadow", "/etc/ptzd/credentials/axis-password"),
    "/dev/ptzd/fisheye",
)


def attempt(path: str, flags: int) -> str:
    try:
        os.close(os.open(path, flags, 0o600))
    except OSError as error:
        return str(error.strerror)
    return "yes"


def main() -> None:
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":\t" in line)
    found = {
        "write": {path: attempt(path, os.O_WRONLY | os.O_CREAT) for path in WRITE},
        "read": {path: attempt(path, os.O_RDONLY | os.O_NONBLOCK) for path in READ},
        "password_length": len((Path(os.environ["CREDENTIALS_DIRECTORY"]) / "axis-password").read_text()),
        "environment": dict(os.environ),
        "capabilities": status["CapBnd"],
        "processes": sum(path.name.isdecimal() for path in Path("/proc").iterdir()),
    }
    Path("/var/lib/ptzd/x").unlink(missing_ok=True)
    Path("/var/log/ptzd/x").unlink(missing_ok=True)
    Path("/var/lib/ptzd/probe.json").write_text(json.dumps(found))


if __name__ == "__main__":
    main()
