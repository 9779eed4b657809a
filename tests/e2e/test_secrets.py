"""The camera's password in the real daemon: in its requests, and nowhere else."""

from __future__ import annotations

import base64
import logging
from pathlib import Path

import msgspec
import pytest

from ptzd.app.simulate import DEFAULT_PASSWORD
from ptzd.cli import entry
from ptzd.sim.auth import Policy
from ptzd.sim.faults import Fault, FaultKind

PAIR = base64.b64encode(f"ptzd:{DEFAULT_PASSWORD}".encode()).decode().rstrip("=")
SECRETS = (DEFAULT_PASSWORD, PAIR, "Authorization", "authorization", "response=")
"""The password, Basic's form of it, and any header that holds it or a digest of it."""


@pytest.mark.parametrize("policy", [Policy.BASIC, Policy.DIGEST])
async def test_it_is_in_no_log_no_message_and_no_status(make_site, caplog, policy: Policy) -> None:
    caplog.set_level(logging.DEBUG)
    site = await make_site(policy=policy)
    site.change(ptz={"allow_basic_over_http": True})
    await site.start()
    await site.lock("first")
    for fault in (Fault(kind=FaultKind.RESET), Fault(kind=FaultKind.STATUS, status=403)):
        await site.until(lambda: site.state in {"IDLE", "HOME"})
        site.rig.inject(fault)
        await site.until_state("FAULT")
        site.rig.camera.faults.clear()
    heard = msgspec.json.encode(site.heard).decode()
    files = [path.read_bytes() for path in (site.folder / "log").iterdir()]
    assert any(b"first" in content for content in files), "the log is written as it is, so it can be searched"
    assert [secret for secret in SECRETS if secret in heard + caplog.text] == []
    assert [secret for secret in SECRETS for content in files if secret.encode() in content] == []


@pytest.mark.parametrize("part", ["ptz", "fisheye"])
def test_a_password_in_a_url_is_refused_without_showing_it(tmp_path: Path, part: str, capsys) -> None:
    urls = {"ptz": "http://127.0.0.1:9", "fisheye": "http://127.0.0.1:9/mjpeg"} | {
        part: "http://operator:swordfish@127.0.0.1:9/x"
    }
    (tmp_path / "secret").write_text("other\n")
    (tmp_path / "rig.yaml").write_text((Path(__file__).parents[2] / "config" / "rig.example.yaml").read_text())
    (tmp_path / "ptzd.yaml").write_text(
        f"rig: test\ncalibration: rig.yaml\nfisheye: {{source: http, url: '{urls['fisheye']}'}}\n"
        f"ptz: {{url: '{urls['ptz']}', user: operator, password_file: secret}}\n"
    )
    for command in ("check", "run"):
        assert entry([command, "--config", str(tmp_path / "ptzd.yaml")]) == 78
        said = "".join(capsys.readouterr())
        assert f"{part}.url" in said
        assert "swordfish" not in said
    assert not (tmp_path / "log").exists(), "a log would hold the settings"
