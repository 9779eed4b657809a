"""What a person gets wrong before the first request: one clear line with the culprit, the right exit code, no harm."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from ptzd.cli import entry
from ptzd.errors import RequestRefused
from ptzd.sim.auth import Gate
from ptzd.sim.scene import Scene

CALIBRATION = (Path(__file__).parents[2] / "config" / "rig.example.yaml").read_text()


@pytest.fixture
def nobody(new_port: Callable[[], int]) -> str:
    """URL of a camera that nobody has heard of."""
    return f"http://127.0.0.1:{new_port()}"


@pytest.fixture
def folder(tmp_path: Path, endpoint: str, nobody: str) -> Path:
    """Settings of a daemon whose cameras nobody has heard of."""
    (tmp_path / "rig.yaml").write_text(CALIBRATION)
    (tmp_path / "password").write_text("swordfish\n")
    (tmp_path / "ptzd.yaml").write_text(
        yaml.safe_dump(
            {
                "rig": "test",
                "calibration": "rig.yaml",
                "fisheye": {"source": "http", "url": f"{nobody}/fisheye.mjpg"},
                "ptz": {"url": nobody, "user": "operator", "password_file": "password"},
                "bus": {"listen": [endpoint]},
                "log": {"directory": "log", "min_free_bytes": 0},
            }
        )
    )
    return tmp_path


@pytest.fixture
def change(folder: Path) -> Callable[[str, object], None]:
    """Sets one key, by its path, in the settings; ``None`` takes it out."""

    def put(path: str, value: object) -> None:
        file = folder / "ptzd.yaml"
        document = part = yaml.safe_load(file.read_text())
        *parents, last = path.split(".")
        for name in parents:
            part = part.setdefault(name, {})
        if value is None:
            del part[last]
        else:
            part[last] = value
        file.write_text(yaml.safe_dump(document))

    return put


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that somebody else listens on."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def complaint(capsys: pytest.CaptureFixture[str], *, after: str = "") -> str:
    """The one line on stderr, and nothing else but what began with ``after`` on stdout."""
    said = capsys.readouterr()
    assert bool(said.out) == bool(after)
    assert said.out.startswith(after)
    lines = said.err.splitlines()
    assert len(lines) == 1, said.err
    assert lines[0].startswith("ptzd: ")
    return lines[0]


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    ("path", "value", "culprit"),
    [
        ("lock.holds_s", 3, "lock: Object contains unknown field `holds_s`"),
        ("ptz.fps", -1, "ptz.fps"),
        ("ptz.url", None, "ptz: Object missing required field `url`"),
        ("search.range_m", [5.0, 2.0], "search.range_m: the first value must be below the second"),
        ("search.matcher", "magic", "search.matcher"),
        ("home.pan_deg", 300.0, "home.pan_deg: 300.0 is outside limits.pan_deg"),
        ("lock.tolerance_deg", float("nan"), "lock.tolerance_deg: nan is no number"),
        ("fisheye.source", "usb", "fisheye"),
        ("rig", "my rig", "rig"),
        ("home.zoom", 0.5, "home.zoom"),
    ],
)
def test_a_bad_setting_is_named_by_its_path(folder, change, capsys, command, path, value, culprit) -> None:
    change(path, value)
    assert entry([command, "--config", str(folder / "ptzd.yaml")]) == 78
    line = complaint(capsys)
    assert culprit in line
    assert not (folder / "log").exists()


@pytest.mark.parametrize("text", ["rig: [", "- just\n- a list", "", "\xff"])
def test_a_file_that_is_no_settings_file(folder: Path, capsys, text: str) -> None:
    (folder / "ptzd.yaml").write_bytes(text.encode("latin-1"))
    assert entry(["check", "--config", str(folder / "ptzd.yaml")]) == 78
    assert str(folder / "ptzd.yaml") in complaint(capsys)


def test_a_settings_file_that_is_not_there(tmp_path: Path, capsys) -> None:
    assert entry(["run", "--config", str(tmp_path / "none.yaml")]) == 78
    assert "none.yaml: No such file" in complaint(capsys)


def test_a_missing_calibration(folder: Path, capsys) -> None:
    (folder / "rig.yaml").unlink()
    assert entry(["run", "--config", str(folder / "ptzd.yaml")]) == 78
    line = complaint(capsys)
    assert "calibration" in line
    assert str(folder / "rig.yaml") in line
    assert "ptzd calibrate" in line


@pytest.mark.parametrize(
    ("old", "new", "culprit"),
    [
        ("xi: 1.2", "xi: nan", "fisheye.xi"),
        ("ptzd_calibration: 1 ", "ptzd_calibration: 7 ", "ptzd_calibration"),
        ("metric: true", "metrical: true", "rig"),
        ("uncertainty:", "uncertain:", "uncertain"),
        ("  size_px: [640, 480]\n  zoom:", "  size_px: [800, 600]\n  zoom:", "ptz.size_px"),
    ],
)
def test_a_wrong_calibration_is_named_by_its_path(folder: Path, capsys, old: str, new: str, culprit: str) -> None:
    assert old in CALIBRATION
    (folder / "rig.yaml").write_text(CALIBRATION.replace(old, new, 1))
    assert entry(["check", "--config", str(folder / "ptzd.yaml")]) == 78
    line = complaint(capsys)
    assert culprit in line
    assert "rig.yaml" in line


def test_a_bus_port_in_use(folder: Path, change, capsys, taken: int) -> None:
    change("bus.listen", [f"tcp/127.0.0.1:{taken}"])
    assert entry(["run", "--config", str(folder / "ptzd.yaml")]) == 69
    line = complaint(capsys)
    assert f"127.0.0.1:{taken}" in line
    assert "already in use" in line
    assert not list((folder / "log").glob("*.active"))


@pytest.mark.parametrize("which", ["--port", "--fisheye-port", "--truth-port"])
def test_a_simulator_port_in_use(capsys, monkeypatch, hall: Scene, taken: int, which: str) -> None:
    monkeypatch.setattr("ptzd.sim.rig.load_scene", lambda _name: hall)
    ports = {"--port": 0, "--fisheye-port": 0, "--truth-port": 0} | {which: taken}
    arguments = [text for name, port in ports.items() for text in (name, str(port))]
    assert entry(["sim", "--scene", "pair_hall", *arguments]) in {65, 69}
    assert str(taken) in complaint(capsys)


def test_a_password_file_that_is_not_there(folder: Path, change, capsys) -> None:
    change("ptz.password_file", "nowhere")
    assert entry(["run", "--config", str(folder / "ptzd.yaml")]) == 78
    assert "ptz.password_file" in complaint(capsys)
    assert entry(["check", "--config", str(folder / "ptzd.yaml"), "--connect"]) == 78
    assert "ptz.password_file" in complaint(capsys, after="settings")


def test_a_log_directory_that_cannot_be_made(folder: Path, change, capsys) -> None:
    change("log.directory", "password/log")
    assert entry(["run", "--config", str(folder / "ptzd.yaml")]) == 65
    assert "log.directory" in complaint(capsys)


def test_check_says_that_a_camera_does_not_answer(folder: Path, nobody: str, capsys) -> None:
    assert entry(["check", "--config", str(folder / "ptzd.yaml"), "--connect"]) == 69
    assert nobody in complaint(capsys, after="settings")


async def test_a_wrong_password_is_said_once_and_not_tried_again(make_site, monkeypatch, caplog) -> None:
    tries: list[str] = []
    check = Gate.check

    def counted(self, now_s, **request):
        if request["authorization"] is not None:
            tries.append(request["target"])
        return check(self, now_s, **request)

    monkeypatch.setattr(Gate, "check", counted)
    site = await make_site()
    (site.folder / "password").write_text("swordfish\n")
    await site.start(wait_ready=False)
    await site.until(lambda: "password" in site.status.ptz)
    assert len(tries) <= 2
    told = len(site.statuses)
    await site.until(lambda: len(site.statuses) >= told + 3)
    assert len(tries) <= 2, "cameras block an address that hammers them"
    reason = site.status.ptz
    assert site.rig.camera_url in reason
    assert "401" in reason
    assert "\n" not in reason
    assert site.state == "STARTING"
    with pytest.raises(RequestRefused, match="password"):
        await site.client.request(box=site.box, id="early")
    lines = [record.getMessage() for record in caplog.records if "ptz lost" in record.getMessage()]
    assert lines == [f"ptz lost: {reason}"]
    assert site.orders == 0
    assert "swordfish" not in caplog.text
    assert all(b"swordfish" not in path.read_bytes() for path in (site.folder / "log").iterdir())
