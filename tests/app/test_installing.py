from __future__ import annotations

from pathlib import Path

import pytest

from ptzd.app import installing
from ptzd.errors import ConfigError, PtzdError

UNIT = "etc/systemd/system/ptzd.service"


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "usr/local/bin/ptzd"
    path.parent.mkdir(parents=True)
    path.touch()
    return path


def test_the_unit_runs_the_installed_program_and_is_else_as_shipped(tmp_path, program):
    written = installing.write_files(program, tmp_path)
    shipped = (installing.shipped_files() / "ptzd.service").read_text()
    unit = (tmp_path / UNIT).read_text()
    assert f"ExecStart={program} run --config /etc/ptzd/ptzd.yaml\n" in unit
    assert unit.replace(str(program), installing.PACKAGED_PROGRAM) == shipped
    assert sorted(str(path.relative_to(tmp_path)) for path in written) == [
        *("etc/systemd/system/ptzd.service", "etc/sysusers.d/ptzd.conf"),
        *("etc/tmpfiles.d/ptzd.conf", "etc/udev/rules.d/70-ptzd.rules"),
    ]


def test_writing_again_changes_nothing(tmp_path, program):
    before = [path.read_text() for path in installing.write_files(program, tmp_path)]
    assert [path.read_text() for path in installing.write_files(program, tmp_path)] == before


@pytest.mark.parametrize("place", ["home/me/.local/bin", "root/.local/bin"])
def test_a_program_that_the_service_cannot_see_is_refused_with_the_cure(tmp_path, place):
    with pytest.raises(ConfigError, match=r"sees nothing below /(home|root); install with PIPX_HOME=/opt/pipx"):
        installing.write_files(tmp_path / place / "ptzd", tmp_path)
    assert not (tmp_path / UNIT).exists()


def test_a_link_into_a_home_is_seen_through(tmp_path):
    target = tmp_path / "home/me/venv/bin/ptzd"
    target.parent.mkdir(parents=True)
    target.touch()
    link = tmp_path / "usr/bin/ptzd"
    link.parent.mkdir(parents=True)
    link.symlink_to(target)
    with pytest.raises(ConfigError, match="below /home"):
        installing.write_files(link, tmp_path)


def test_a_place_that_cannot_be_written_is_named(tmp_path, program):
    (tmp_path / "etc").touch()
    with pytest.raises(PtzdError, match=r"etc/systemd/system/ptzd.service: .*; run this as root"):
        installing.write_files(program, tmp_path)


def test_every_shipped_file_has_a_place():
    shipped = {
        str(path.relative_to(installing.shipped_files()))
        for path in installing.shipped_files().rglob("*")
        if path.is_file() and "examples" not in path.parts
    }
    assert shipped == set(installing.PLACES)


def test_the_account_is_made_before_the_folders_that_it_owns_and_nothing_is_started():
    done = []
    installing.activate(done.append)
    names = [step[0] for step in done]
    assert names.index("systemd-sysusers") < names.index("systemd-tmpfiles")
    assert done[-1] == ("systemctl", "enable", "ptzd.service")
    assert not any("start" in step for step in done)


def test_a_step_that_fails_says_what_it_said(monkeypatch):
    monkeypatch.setattr(installing, "STEPS", (("sh", "-c", "echo no room >&2; exit 3"),))
    with pytest.raises(PtzdError, match="no room"):
        installing.activate()


def test_a_machine_without_the_service_manager_is_told(monkeypatch):
    monkeypatch.setattr(installing, "STEPS", (("no-such-program-here",),))
    with pytest.raises(PtzdError, match="not run by systemd"):
        installing.activate()


def test_the_folder_of_an_installation_comes_before_the_source_tree(tmp_path, monkeypatch):
    folder = tmp_path / "share/ptzd/systemd"
    folder.mkdir(parents=True)
    (folder / "ptzd.service").touch()
    monkeypatch.setattr(installing.sysconfig, "get_path", lambda name: {"data": str(tmp_path)}[name])
    assert installing.shipped_files() == folder


def test_an_installation_without_the_files_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(installing.sysconfig, "get_path", lambda name: {"data": str(tmp_path)}[name])
    monkeypatch.setattr(installing.ptzd, "__file__", str(Path(tmp_path, "ptzd", "__init__.py")))
    with pytest.raises(ConfigError, match="are not there"):
        installing.shipped_files()
