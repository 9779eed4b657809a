from __future__ import annotations

import pickle
import traceback

import pytest

from ptzd.config import HttpSource, Limits
from ptzd.devices.http_fisheye import HttpFisheye
from ptzd.devices.vapix.credentials import Credentials, Secret, exposure, read_credentials
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import ConfigError


def test_one_line_of_a_file(tmp_path):
    (tmp_path / "p").write_bytes("päss wörd\r\n".encode())
    assert read_credentials("u", str(tmp_path / "p"), setting="ptz").password.reveal() == "päss wörd"


def test_the_systemd_credential(tmp_path):
    (tmp_path / "axis-password").write_text("x")
    found = read_credentials("u", None, setting="ptz", environment={"CREDENTIALS_DIRECTORY": str(tmp_path)})
    assert found == Credentials(user="u", password=Secret("x"))


@pytest.mark.parametrize("content", [b"", b"\n", b"one\ntwo\n", b"hunter\xff2", b"x" * 2000])
def test_anything_else_is_refused_without_showing_it(tmp_path, content):
    path = tmp_path / "p"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"^ptz\.password_file: ") as refused:
        read_credentials("u", str(path), setting="ptz")
    text = "".join(traceback.format_exception(refused.value))
    assert "hunter" not in text
    assert "two" not in text.replace("between two", "")


def test_a_missing_file_and_a_missing_credential_are_named(tmp_path):
    with pytest.raises(ConfigError, match=r"fisheye\.password_file: cannot read .*nowhere: No such file"):
        read_credentials("u", str(tmp_path / "nowhere"), setting="fisheye")
    with pytest.raises(ConfigError, match="systemd credential axis-password"):
        read_credentials("u", None, setting="ptz", environment={})


def test_a_secret_shows_itself_nowhere():
    credentials = Credentials(user="u", password=Secret("hunter2"))
    assert "hunter2" not in f"{credentials} {credentials!r} {credentials.password} {[credentials]}"
    with pytest.raises(TypeError):
        pickle.dumps(credentials.password)


@pytest.mark.parametrize(("mode", "told"), [(0o644, True), (0o604, True), (0o600, False), (0o440, False)])
def test_a_file_that_everybody_can_read_is_named_with_the_cure(tmp_path, mode, told):
    path = tmp_path / "p"
    path.write_text("hunter2")
    path.chmod(mode)
    warning = exposure(str(path), setting="ptz")
    assert (warning is not None) is told
    if warning is not None:
        assert warning.startswith("ptz.password_file: every user can read ")
        assert f"(mode {mode:o}); run chmod 600 {path}" in warning
        assert "hunter2" not in warning


def test_what_is_not_there_is_not_warned_about(tmp_path):
    assert exposure(None, setting="ptz") is None
    assert exposure(str(tmp_path / "nowhere"), setting="ptz") is None


@pytest.mark.parametrize("mode", [0o644, 0o600])
async def test_it_is_said_when_a_camera_is_opened(camera, settings_for, clock, password_file, caplog, mode):
    password_file.chmod(mode)
    fisheye = HttpSource(url=f"{camera.url}/fisheye.mjpg", user="ptzd", password_file=str(password_file))
    async with VapixHead(settings_for(camera), Limits(), clock), HttpFisheye(fisheye, clock):
        pass
    said = [record.message.partition(":")[0] for record in caplog.records]
    assert said == (["ptz.password_file", "fisheye.password_file"] if mode == 0o644 else [])
