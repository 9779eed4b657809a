"""User and password of a camera: read from a file, shown to nobody."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ptzd.documents import read_regular
from ptzd.errors import ConfigError

CREDENTIAL_NAME = "axis-password"
"""Name of the systemd credential (``LoadCredential=axis-password:…``)."""
MAX_PASSWORD_BYTES = 1024


class Secret:
    """A text that does not show itself: not in ``repr``, not in a format, not in a pickle."""

    __slots__ = ("_text",)

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        """The text itself, for the one place that computes an authorization from it."""
        return self._text

    def __repr__(self) -> str:
        return "Secret(…)"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Secret) and other._text == self._text

    def __hash__(self) -> int:
        return hash((Secret, self._text))

    def __reduce__(self) -> str:
        raise TypeError("a secret is not written anywhere")


@dataclass(frozen=True, slots=True, kw_only=True)
class Credentials:
    """Who asks."""

    user: str
    password: Secret = field(repr=False)


def read_credentials(
    user: str, password_file: str | None, *, setting: str, environment: Mapping[str, str] = os.environ
) -> Credentials:
    """Read the password of ``user``.

    Parameters
    ----------
    user : str
    password_file : str or None
        A file with the password in its only line; None = the systemd credential ``axis-password``.
    setting : str
        Part of the settings, for messages, e.g. ``ptz``.
    environment : Mapping
        Where ``CREDENTIALS_DIRECTORY`` is looked up.

    Raises
    ------
    ConfigError
        The file is missing, unreadable, empty, longer than one line, or not UTF-8.
    """
    culprit = f"{setting}.password_file"
    path = _path(password_file, culprit, environment)
    try:
        data = read_regular(path, MAX_PASSWORD_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{culprit}: cannot read {path}: {error.strerror}") from None
    return Credentials(user=user, password=Secret(_only_line(data, culprit, path)))


def exposure(password_file: str | None, *, setting: str) -> str | None:
    """Warning when every user of this machine can read the password.

    Parameters
    ----------
    password_file : str or None
        As for :func:`read_credentials`; a systemd credential is never exposed.
    setting : str
        Part of the settings, for the message.

    Returns
    -------
    str or None
        One sentence with file, mode and cure; None when others cannot read it, or there is no such file.
    """
    if password_file is None:
        return None
    try:
        mode = Path(password_file).expanduser().stat().st_mode
    except OSError:
        return None
    if not mode & stat.S_IROTH:
        return None
    shown = f"mode {stat.S_IMODE(mode):o}"
    return f"{setting}.password_file: every user can read {password_file} ({shown}); run chmod 600 {password_file}"


def _path(password_file: str | None, culprit: str, environment: Mapping[str, str]) -> Path:
    if password_file is not None:
        return Path(password_file).expanduser()
    directory = environment.get("CREDENTIALS_DIRECTORY")
    if directory is None:
        raise ConfigError(
            f"{culprit}: no password; name a file with one line, "
            f"or give the service the systemd credential {CREDENTIAL_NAME}"
        )
    return Path(directory) / CREDENTIAL_NAME


def _only_line(data: bytes, culprit: str, path: Path) -> str:
    # The content never gets into a message, not even through a chained UnicodeDecodeError.
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        raise ConfigError(f"{culprit}: {path} is not UTF-8 text") from None
    lines = text.splitlines()
    if len(lines) != 1 or not lines[0] or len(data) > MAX_PASSWORD_BYTES:
        raise ConfigError(f"{culprit}: {path} must hold the password in one line of at most {MAX_PASSWORD_BYTES} bytes")
    return lines[0]
