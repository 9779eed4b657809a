"""`pipx install .` and `ptzd install-service`: what an installation from the wheel brings along."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = ("ptzd", "setup.py", "systemd", "config", "pyproject.toml", "README.md", "LICENSE")
INSTALL = "import sys; from pathlib import Path; from ptzd.app.installing import write_files; \
write_files(Path(sys.argv[1]), Path(sys.argv[2]))"


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The program of a virtual environment of its own, installed from a copy of the sources."""
    folder = tmp_path_factory.mktemp("installation")
    for name in PARTS:
        source, copy = ROOT / name, folder / "source" / name
        shutil.copytree(source, copy) if source.is_dir() else shutil.copy(source, folder / "source")
    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps", "--no-build-isolation",
        "--wheel-dir", str(folder), str(folder / "source"))  # fmt: skip
    (wheel,) = folder.glob("*.whl")
    python = folder / "venv/bin/python"
    run(sys.executable, "-m", "venv", "--without-pip", str(folder / "venv"))
    run(sys.executable, "-m", "pip", f"--python={python}", "install", "--quiet", "--no-index", "--no-deps", str(wheel))
    libraries = folder / "venv/lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}/site-packages/borrowed.pth"
    libraries.write_text(sysconfig.get_path("purelib"))
    return folder / "venv/bin/ptzd"


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_program_starts_and_its_service_files_came_along(program, tmp_path):
    assert "ptzd" in run(str(program), "--version")
    run(str(program.with_name("python")), "-I", "-c", INSTALL, str(program), str(tmp_path))
    unit = (tmp_path / "etc/systemd/system/ptzd.service").read_text()
    shipped = (ROOT / "systemd/ptzd.service").read_text()
    assert unit == shipped.replace("/usr/bin/ptzd", str(program))
    if shutil.which("systemd-analyze"):
        run("systemd-analyze", "verify", str(tmp_path / "etc/systemd/system/ptzd.service"))
    share = program.parents[1] / "share/ptzd"
    assert {path.name for path in (share / "config").iterdir()} == {path.name for path in (ROOT / "config").iterdir()}
