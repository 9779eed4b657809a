"""`ptzd install-service`: the service's files for an installation that no package manager looks after."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path

import ptzd
from ptzd.errors import ConfigError, PtzdError

PACKAGED_PROGRAM = "/usr/bin/ptzd"
"""What the shipped unit runs."""

PLACES = {
    "ptzd.service": "etc/systemd/system",
    "sysusers.d/ptzd.conf": "etc/sysusers.d",
    "tmpfiles.d/ptzd.conf": "etc/tmpfiles.d",
    "udev/70-ptzd.rules": "etc/udev/rules.d",
}
"""Where an administrator's own files go; a package's go below /usr/lib and do not get into their way."""

HIDDEN = ("home", "root", "run/user")
"""Below these the confined service sees nothing (``ProtectHome=yes``)."""

STEPS = (
    ("systemd-sysusers",),
    ("systemd-tmpfiles", "--create", "ptzd.conf"),
    ("udevadm", "control", "--reload"),
    ("udevadm", "trigger", "--subsystem-match=video4linux"),
    ("systemctl", "daemon-reload"),
    ("systemctl", "enable", "ptzd.service"),
)


def shipped_files() -> Path:
    """Folder with the service's files: beside the installed libraries, or in the source tree.

    Raises
    ------
    ConfigError
        This installation has none.
    """
    installed = Path(sysconfig.get_path("data"), "share/ptzd/systemd")
    source_tree = Path(ptzd.__file__).parents[1] / "systemd"
    for folder in (installed, source_tree):
        if (folder / "ptzd.service").is_file():
            return folder
    raise ConfigError(f"{installed}: the service's files are not there; install ptzd again with pipx")


def write_files(program: Path, root: Path = Path("/")) -> tuple[Path, ...]:
    """Write unit, account, folders and device rule for a program.

    Parameters
    ----------
    program : Path
        The ``ptzd`` that the service runs.
    root : Path
        Top of the file system.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    ConfigError
        The program lies where the confined service cannot see it.
    PtzdError
        A file cannot be written.
    """
    program = program.absolute()
    hidden = [top for top in HIDDEN for path in (program, program.resolve()) if path.is_relative_to(root / top)]
    if hidden:
        raise ConfigError(
            f"{program}: the service sees nothing below /{hidden[0]}; install with "
            "PIPX_HOME=/opt/pipx PIPX_BIN_DIR=/usr/local/bin pipx install ptzd"
        )
    source, written = shipped_files(), []
    for name, place in PLACES.items():
        path = root / place / Path(name).name
        text = (source / name).read_text()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text.replace(f"={PACKAGED_PROGRAM} ", f"={program} "))
        except OSError as error:
            raise PtzdError(f"{path}: {error.strerror}; run this as root") from None
        written.append(path)
    return tuple(written)


def activate(run: Callable[[Sequence[str]], object] | None = None) -> None:
    """Make account and folders, and let the service manager know; the service is enabled, not started.

    Raises
    ------
    PtzdError
        A step fails, with what it said.
    """
    for step in STEPS:
        (run or _run)(step)


def _run(command: Sequence[str]) -> None:
    if shutil.which(command[0]) is None:
        raise PtzdError(f"{command[0]}: not found; this machine is not run by systemd")
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "LC_ALL": "C"})  # noqa: S603  # fixed commands
    if done.returncode:
        raise PtzdError(f"{' '.join(command)}: {' '.join(done.stderr.split()) or f'exit {done.returncode}'}")
