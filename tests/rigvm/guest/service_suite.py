"""The installed service on a simulated rig: request, hang, stall, unplug, kill, confinement, removal."""

from __future__ import annotations

import asyncio
import json
import math
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from checks import Checks, UvcCamera, shell
from mcap.exceptions import McapError
from mcap.reader import make_reader

from ptzd.bus.client import Client
from ptzd.bus.messages import RoiResult
from ptzd.errors import BusError, RequestRefused

ETC = Path("/etc/ptzd")
RIG = Path("/run/rig")
PICTURES = Path("/run/fisheye")
PASSWORD = "seen-by-nobody-else"
BOX = (261, 197, 34, 28)
ATTEMPTS = 4
BUS = "tcp/127.0.0.1:7447"
PATIENCE_S = 120.0
"""For an answer that a machine gives within two seconds."""
DROP_IN = """[Service]
# The guest computes some thirty times slower than a machine.
TimeoutStartSec=900
WatchdogSec=60
"""


def run(checks: Checks) -> None:
    checks.that("enabled by its installation", shell("systemctl is-enabled ptzd") == "enabled")
    checks.that("not started without settings", shell("systemctl is-active ptzd") == "inactive")
    shell("modprobe uvcvideo nodrop=1; modprobe vhci-hcd")
    with simulator() as facts:
        settings = prepare(facts)
        with UvcCamera(PICTURES, "640x480", 2).plugged_in() as camera:
            checks.until("the fisheye has its stable name", Path("/dev/ptzd/fisheye").exists)
            check_check(checks)
            check_confinement(checks)
            check_start(checks)
            check_request(checks, facts)
            check_secret(checks)
            check_reload(checks, settings)
            check_loss(checks, camera, "stall", "resume")
            check_loss(checks, camera, "detach", "attach")
            check_falls(checks)
            check_stop(checks)
    check_upgrade_and_purge(checks, settings)
    check_other_installation(checks, settings)


@contextmanager
def simulator() -> Iterator[dict[str, str]]:
    """The simulated AXIS camera as a service of its own; yields its addresses."""
    RIG.mkdir(exist_ok=True)
    secret = RIG / "secret"
    secret.touch(mode=0o600)
    secret.write_text(PASSWORD + "\n")
    shell(
        "systemd-run --unit=rigsim --property=StandardOutput=file:/run/rig/facts --property=StandardError=journal "
        f"/usr/bin/ptzd sim --scene room --write-config {RIG} --password-file {secret} --json"
    )
    facts = RIG / "facts"
    end_s = time.monotonic() + 300
    while not (facts.exists() and facts.read_text().strip()) and time.monotonic() < end_s:
        time.sleep(0.5)
    try:
        yield json.loads(facts.read_text() or "{}")
    finally:
        shell("systemctl stop rigsim")


def prepare(facts: dict[str, str]) -> str:
    """Settings for a fisheye behind the driver, the password as a credential, pictures for the camera to show."""
    settings = yaml.safe_load((RIG / "ptzd.yaml").read_text())
    settings["fisheye"] = {
        "source": "v4l2",
        "device": "/dev/ptzd/fisheye",
        "size_px": [640, 480],
        "fps": 2,
        "stall_s": 15.0,
    }
    del settings["ptz"]["password_file"]
    settings["ptz"] |= {"fps": 2, "poll_hz": 2, "move_timeout_s": 120.0, "stall_s": 60.0}
    settings["queue"] = {"timeout_s": 1200.0}
    settings["search"] = {"frame_max_age_s": 60.0}
    settings["log"] = {"directory": "/var/log/ptzd", "min_free_bytes": 50_000_000}
    (ETC / "credentials/axis-password").write_text(PASSWORD + "\n")
    (ETC / "credentials/axis-password").chmod(0o600)
    (ETC / "rig.yaml").write_text((RIG / "rig.yaml").read_text())
    drop_in = Path("/etc/systemd/system/ptzd.service.d/slow.conf")
    drop_in.parent.mkdir(parents=True, exist_ok=True)
    drop_in.write_text(DROP_IN)
    PICTURES.mkdir(exist_ok=True)
    for number, jpeg in enumerate(first_pictures(facts["fisheye_url"], 4)):
        (PICTURES / f"{number}.jpg").write_bytes(jpeg)
    text = yaml.safe_dump(settings)
    (ETC / "ptzd.yaml").write_text(text)
    return text


def first_pictures(url: str, count: int) -> list[bytes]:
    """Pictures of an MJPEG stream, cut at their markers."""
    pictures: list[bytes] = []
    buffered = b""
    with urllib.request.urlopen(url, timeout=120) as stream:
        while len(pictures) < count:
            buffered += stream.read1(65536)
            begin = buffered.find(b"\xff\xd8")
            end = buffered.find(b"\xff\xd9", begin)
            if begin >= 0 and end >= 0:
                pictures.append(buffered[begin : end + 2])
                buffered = buffered[end + 2 :]
    return pictures


def property_of(name: str) -> str:
    return shell(f"systemctl show ptzd --property={name} --value")


def rig_state() -> str:
    """What the daemon answers on the bus; empty when it does not."""

    async def ask() -> str:
        async with Client.open(BUS, rig="demo", timeout_s=PATIENCE_S) as client:
            return (await client.status()).state

    try:
        return asyncio.run(ask())
    except BusError:
        return ""


def look_at_box(name: str, limit_s: float) -> RoiResult | RequestRefused | BusError:
    """Ask for the box and wait for its result; one that was taken in but not confirmed in time still gets one."""

    async def ask() -> RoiResult:
        async with Client.open(BUS, rig="demo", timeout_s=PATIENCE_S) as client:
            begin_s = time.monotonic()
            try:
                await client.request(box=BOX, id=name, hold_s=1.0, timeout_s=limit_s)
            except RequestRefused as refused:
                if refused.code != "internal":
                    raise
            print(f"     answered after {time.monotonic() - begin_s:.1f} s", flush=True)
            async for step in client.feedback(name):
                print(f"     {time.monotonic() - begin_s:.1f} s", step.step, step.detail, flush=True)
            return await client.result(name, timeout_s=limit_s)

    try:
        return asyncio.run(asyncio.wait_for(ask(), limit_s + PATIENCE_S))
    except TimeoutError:
        return BusError(f"no result within {limit_s:g} s")
    except (RequestRefused, BusError) as error:
        return error


def active() -> bool:
    return shell("systemctl is-active ptzd") == "active"


def well() -> bool:
    return active() and rig_state() == "IDLE"


def check_check(checks: Checks) -> None:
    """What its owner asks before starting the service."""
    said = shell("CREDENTIALS_DIRECTORY=/etc/ptzd/credentials ptzd check --config /etc/ptzd/ptzd.yaml", limit_s=900)
    checks.that("`ptzd check` lists the camera", "/dev/ptzd/fisheye: " in said, said.splitlines()[5:6])
    checks.that("with its formats", "MJPG: 640x480" in said)


def check_start(checks: Checks) -> None:
    begin_s = time.monotonic()
    said = shell("systemctl daemon-reload; systemctl start ptzd", limit_s=900)
    took_s = time.monotonic() - begin_s
    if not checks.that("the service starts and says that it is ready", active(), f"{took_s:.0f} s {said}"):
        raise RuntimeError("the service does not start")
    checks.until("the rig is idle", well, 300)
    checks.that("its state is in its status", "idle" in property_of("StatusText").lower(), property_of("StatusText"))
    seen = shell("ptzd status", limit_s=600)
    checks.that("the command line reaches it", "fisheye" in seen and "well" in seen, seen.splitlines()[:1])
    checks.that("it runs as its own user", shell(f"stat -c %U /proc/{property_of('MainPID')}") == "ptzd")


def check_request(checks: Checks, facts: dict[str, str]) -> None:
    """A guest that shares its processors may see the box too late, or the head too slow: it may try again."""
    for attempt in range(1, ATTEMPTS + 1):
        begin_s = time.monotonic()
        result = look_at_box(f"try-{attempt}", 400.0)
        if isinstance(result, RoiResult) and result.outcome == "locked":
            break
    seen = f"{result} at attempt {attempt} after {time.monotonic() - begin_s:.0f} s"
    if checks.that("a box is locked", isinstance(result, RoiResult) and result.outcome == "locked", seen):
        off_deg = error_deg(facts["truth_url"], result)
        checks.that("on what the fisheye sees there", off_deg <= 0.5, f"{off_deg:.3f} deg off the truth")
    told = shell(f"journalctl --no-pager --output=cat PTZD_REQUEST=try-{attempt}").splitlines()
    checks.that("the journal has the request by its field", len(told) == 2 and "accepted" in told[0], told)


def error_deg(truth_url: str, result: RoiResult) -> float:
    """Angle between where the head was pointed and the true direction of the box's centre."""
    centre = f"x={BOX[0] + BOX[2] / 2}&y={BOX[1] + BOX[3] / 2}"
    with urllib.request.urlopen(f"{truth_url}/truth/direction?{centre}", timeout=120) as reply:
        truth = json.load(reply)
    pan, tilt, true_pan, true_tilt = (
        math.radians(float(angle)) for angle in (result.pan_deg, result.tilt_deg, truth["pan_deg"], truth["tilt_deg"])
    )
    cosine = math.sin(tilt) * math.sin(true_tilt) + math.cos(tilt) * math.cos(true_tilt) * math.cos(pan - true_pan)
    return math.degrees(math.acos(min(1.0, cosine)))


def check_confinement(checks: Checks) -> None:
    """What the service can reach, tried by a program in its place."""
    unit = Path("/lib/systemd/system/ptzd.service").read_text()
    unit = unit.replace(
        "/usr/bin/ptzd run --config /etc/ptzd/ptzd.yaml", "/usr/lib/ptzd/bin/python3 /usr/local/probe.py"
    )
    unit = unit.replace("Type=notify", "Type=oneshot").replace("Restart=always", "Restart=no")
    unit = unit.replace("WatchdogSec=15\n", "").replace("TimeoutStartSec=60", "TimeoutStartSec=900")
    Path("/etc/systemd/system/probe.service").write_text(unit)
    Path("/usr/local/probe.py").write_text(Path(__file__).with_name("probe.py").read_text())
    shell("chmod 666 /dev/ttyS0; systemctl daemon-reload")
    said = shell("systemctl start probe.service", limit_s=900)
    try:
        found = json.loads(Path("/var/lib/ptzd/probe.json").read_text())
    except (OSError, ValueError) as error:
        checks.that("a probe runs in the service's place", holds=False, seen=f"{error} {said}")
        return
    for path in ("/etc/x", "/usr/x", "/root/x", "/mnt/share/x", "/etc/ptzd/x"):
        checks.that(f"{path} cannot be written", found["write"][path] != "yes", found["write"][path])
    for path in ("/var/lib/ptzd/x", "/var/log/ptzd/x", "/run/ptzd/x", "/tmp/x"):
        checks.that(f"{path} can be written", found["write"][path] == "yes", found["write"][path])
    for path in ("/dev/ttyS0", "/dev/vda", "/dev/mem", "/etc/shadow", "/etc/ptzd/credentials/axis-password"):
        checks.that(f"{path} cannot be opened", found["read"][path] != "yes", found["read"][path])
    checks.that("the fisheye can be opened", found["read"]["/dev/ptzd/fisheye"] == "yes", found["read"])
    checks.that("the password is there for the service", found["password_length"] == len(PASSWORD) + 1)
    checks.that("and in no environment", PASSWORD not in json.dumps(found["environment"]))
    checks.that("it has no capabilities", int(found["capabilities"], 16) == 0, found["capabilities"])
    checks.that("other processes are invisible", found["processes"] == 1, found["processes"])


def check_secret(checks: Checks) -> None:
    denied = shell("setpriv --reuid=65534 --clear-groups cat /run/credentials/ptzd.service/axis-password")
    checks.that("nobody else reads the password", "Permission denied" in denied, denied)
    nowhere = shell(f"grep -rl {PASSWORD} /var/log /var/lib/ptzd; journalctl --no-pager | grep -c {PASSWORD}")
    checks.that("it is in no log and no journal", nowhere == "0", nowhere)


def check_reload(checks: Checks, settings: str) -> None:
    """Settings read again: what can change does, the rest is named, a wrong file changes nothing."""
    pid = property_of("MainPID")
    path = ETC / "ptzd.yaml"
    changed = yaml.safe_load(settings)
    changed["search"]["max_rounds"] = 1
    changed["ptz"]["poll_hz"] = 3
    path.write_text(yaml.safe_dump(changed))
    said = shell("systemctl reload ptzd && echo done", limit_s=900)
    checks.that("a reload is taken", said == "done", said)
    told = "changed search.max_rounds; needs a restart and stays as it was: ptz.poll_hz"
    checks.until("the journal says what changed and what did not", lambda: told in journal(), 120)
    path.write_text("rig: [")
    said = shell("systemctl reload ptzd || echo refused", limit_s=900)
    checks.that("with a wrong file a reload fails", "refused" in said, said)
    shell(f"kill -HUP {pid}")
    checks.until("and a daemon told so all the same keeps what it has", lambda: "settings not taken" in journal(), 120)
    path.write_text(settings)
    checks.that("all the time it was the same process", property_of("MainPID") == pid and well())


def journal() -> str:
    return shell("journalctl --unit=ptzd --no-pager")


def check_loss(checks: Checks, camera: UvcCamera, bad: str, good: str) -> None:
    """The fisheye goes and comes back: the service stays and says so."""
    pid = property_of("MainPID")
    camera.tell(bad)
    checks.until(f"after {bad} the rig says FAULT", lambda: rig_state() == "FAULT", 120)
    checks.that(f"after {bad} the service is up and answers", active() and property_of("MainPID") == pid)
    told = look_at_box(f"during-{bad}", 60.0)
    outcome = told.outcome if isinstance(told, RoiResult) else type(told).__name__
    checks.that(f"after {bad} a request is told why", outcome in ("device_lost", "RequestRefused"), told)
    camera.tell(good)
    checks.until(
        f"after {good} the rig is well without a restart", lambda: well() and property_of("MainPID") == pid, 180
    )


def check_falls(checks: Checks) -> None:
    """A daemon that hangs or is killed comes back, and nothing of the log is lost."""
    pid = property_of("MainPID")
    shell(f"kill -STOP {pid}")
    checks.until("a hung daemon is replaced by the watchdog", lambda: property_of("MainPID") not in (pid, "0"), 300)
    checks.that("the journal says why", "Watchdog timeout" in journal())
    checks.until("and the rig is well again", well, 600)
    pid = property_of("MainPID")
    shell(f"kill -KILL {pid}")
    checks.until("a killed daemon is restarted", lambda: property_of("MainPID") not in (pid, "0"), 300)
    checks.until("and the rig is well once more", well, 600)
    files = sorted(Path("/var/log/ptzd").glob("*.mcap"))
    broken = [path.name for path in files if not is_whole(path)]
    checks.that("every closed log file is whole", files and not broken, f"{len(files)} files {broken}")
    torn = list(Path("/var/log/ptzd").glob("*.active"))
    checks.that("one file is being written, none is left torn", len(torn) == 1, [path.name for path in torn])


def is_whole(path: Path) -> bool:
    """Whether a log file has its index and every message can be read."""
    try:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            count = sum(1 for _ in reader.iter_messages())
    except McapError:
        return False
    return summary is not None and summary.statistics is not None and count == summary.statistics.message_count > 0


def check_stop(checks: Checks) -> None:
    begin_s = time.monotonic()
    shell("systemctl stop ptzd")
    took_s = time.monotonic() - begin_s
    checks.that("it stops when told", property_of("Result") == "success" and took_s < 20, f"{took_s:.1f} s")
    checks.that("the log is closed", not list(Path("/var/log/ptzd").glob("*.active")))


def check_upgrade_and_purge(checks: Checks, settings: str) -> None:
    shell("dpkg --force-unsafe-io --install /mnt/share/ptzd_*.deb", limit_s=1800)
    kept = (ETC / "ptzd.yaml").read_text() == settings and (ETC / "credentials/axis-password").exists()
    checks.that("an upgrade keeps settings and password", kept)
    shell("systemctl stop ptzd; cp --archive /usr/lib/ptzd /opt/ptzd", limit_s=900)
    said = shell("dpkg --purge ptzd", limit_s=900)
    left = [path for path in ("/etc/ptzd", "/var/lib/ptzd", "/var/log/ptzd", "/usr/lib/ptzd") if Path(path).exists()]
    checks.that("purge leaves nothing behind", not left, f"{left} {said if left else ''}")
    checks.that("not even the account", "ptzd" not in shell("getent passwd ptzd; getent group ptzd"))


def check_other_installation(checks: Checks, settings: str) -> None:
    """`ptzd install-service` of an installation that no package manager looks after, as `pipx install` makes it."""
    shell("mkdir -p /opt/ptzd/share/ptzd && cp -r /mnt/share/systemd /mnt/share/config /opt/ptzd/share/ptzd/")
    shell("sed -i '1c #!/opt/ptzd/bin/python3' /opt/ptzd/bin/ptzd")
    said = shell("/opt/ptzd/bin/ptzd install-service", limit_s=900)
    enabled = shell("systemctl is-enabled ptzd") == "enabled"
    checks.that("another installation makes itself a service", enabled, said.splitlines()[-1:])
    (ETC / "ptzd.yaml").write_text(settings)
    (ETC / "rig.yaml").write_text((RIG / "rig.yaml").read_text())
    (ETC / "credentials/axis-password").write_text(PASSWORD + "\n")
    shell("systemctl start ptzd", limit_s=900)
    command = property_of("ExecStart")
    checks.that("that starts the program of this installation", active() and "/opt/ptzd/bin/ptzd" in command, command)
    shell("systemctl stop ptzd", limit_s=300)
