from __future__ import annotations

import pickle
import traceback

import pytest

from ptzd.devices.vapix.credentials import Credentials, Secret, read_credentials
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
