from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

SHIPPED = Path(__file__).parents[2] / "systemd"
EXAMPLES = sorted((SHIPPED / "examples").glob("*.conf"))
EXPOSURE_LIMIT = 15
"""In tenths, as the tool takes it."""

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")


def run(*command):
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def unit(tmp_path):
    """The unit beside which drop-ins can be laid, with a program that exists on every machine."""
    text = (SHIPPED / "ptzd.service").read_text().replace("/usr/bin/ptzd ", "/bin/true ")
    path = tmp_path / "ptzd.service"
    path.write_text(text)
    return path


def lay(unit, drop_in):
    folder = unit.with_name("ptzd.service.d")
    folder.mkdir()
    (folder / drop_in.name).write_text(drop_in.read_text().replace("/usr/bin/ptzd ", "/bin/true "))


@needs_systemd
def test_the_service_manager_takes_every_line_of_the_unit(unit):
    done = run("systemd-analyze", "verify", str(unit))
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
def test_the_unit_is_exposed_as_little_as_promised(unit):
    done = run("systemd-analyze", "security", "--offline=true", f"--threshold={EXPOSURE_LIMIT}", str(unit))
    assert done.returncode == 0, done.stdout.splitlines()[-1]


@needs_systemd
@pytest.mark.parametrize("drop_in", EXAMPLES, ids=lambda path: path.name)
def test_every_example_is_taken_on_top_of_the_unit(unit, drop_in):
    lay(unit, drop_in)
    done = run("systemd-analyze", "verify", str(unit))
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
def test_the_account_is_made_and_may_open_video_devices(tmp_path):
    (tmp_path / "etc").mkdir()
    done = run("systemd-sysusers", f"--root={tmp_path}", str(SHIPPED / "sysusers.d/ptzd.conf"))
    assert done.returncode == 0, done.stderr
    groups = dict(line.split(":", 1) for line in (tmp_path / "etc/group").read_text().splitlines())
    assert "ptzd" in groups["video"]
    assert "/var/lib/ptzd" in (tmp_path / "etc/passwd").read_text()


@needs_systemd
def test_the_folders_are_made_and_passwords_are_for_nobody_else(tmp_path):
    rules = tmp_path / "ptzd.conf"
    rules.write_text(re.sub(r"\bptzd ptzd\b", "- -", (SHIPPED / "tmpfiles.d/ptzd.conf").read_text()))
    done = run("systemd-tmpfiles", "--create", f"--root={tmp_path}", str(rules))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "etc/ptzd/credentials").stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "var/log/ptzd").stat().st_mode & 0o777 == 0o750


@pytest.mark.parametrize("path", [SHIPPED / "udev/70-ptzd.rules", SHIPPED / "examples/71-ptzd-fisheye.rules"])
def test_udev_rules_are_comparisons_then_assignments(path):
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    for line in lines:
        parts = re.findall(r'([A-Z_]+(?:\{\w+\})?)(==|!=|\+=|=)"([^"]+)"(?:, |$)', line)
        assert ", ".join(f'{key}{operator}"{value}"' for key, operator, value in parts) == line
        assigns = [operator in ("+=", "=") for _, operator, _ in parts]
        assert assigns == sorted(assigns)
        assert ("SYMLINK", "+=", "ptzd/fisheye") in parts
