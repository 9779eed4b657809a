"""`systemctl reload ptzd`, or SIGHUP: the settings are read again while the daemon runs.

What can change at once does; the rest is named and stays as it was. A file that is wrong is refused whole.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import msgspec
import yaml

from ptzd.app.loading import Loaded, checked_rig, load
from ptzd.config import WHILE_RUNNING, parse_config
from ptzd.errors import CalibrationError, ConfigError
from ptzd.runtime.notify import Notifier

CALIBRATION = "calibration"

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reload:
    """What reading the settings again leads to."""

    loaded: Loaded
    """What is in force from now on."""
    taken: tuple[str, ...]
    """Keys that change."""
    refused: tuple[str, ...]
    """Keys that need a restart and stay as they were."""

    def __str__(self) -> str:
        taken = f"changed {', '.join(self.taken)}" if self.taken else "nothing changed"
        refused = f"; needs a restart and stays as it was: {', '.join(self.refused)}" if self.refused else ""
        return f"settings read again: {taken}{refused}"


def read_again(running: Loaded) -> Reload:
    """Read the settings file that ``running`` came from and take over what may change.

    Raises
    ------
    ConfigError, CalibrationError
        The file is wrong, or what it changes does not fit what stays.
    """
    asked = load(running.path, shadow=running.shadow)
    document: dict[str, object] = msgspec.to_builtins(running.config)
    taken, refused = [], []
    for part, old, new in _differing(document, msgspec.to_builtins(asked.config)):
        if not isinstance(old, dict) or not isinstance(new, dict):
            refused.append(part)
            continue
        merged = dict(old)
        for key, _, value in _differing(old, new):
            name = f"{part}.{key}"
            if part in WHILE_RUNNING or name in WHILE_RUNNING:
                taken.append(name)
                merged[key] = value
            else:
                refused.append(name)
        document[part] = merged
    if asked.calibration_text != running.calibration_text and CALIBRATION not in refused:
        refused.append(CALIBRATION)
    config = parse_config(document, str(running.path))
    checked_rig(config, running.calibration_text, config.calibration)
    text = yaml.safe_dump(msgspec.to_builtins(config), sort_keys=False)
    loaded = dataclasses.replace(running, config=config, config_text=text)
    return Reload(loaded=loaded, taken=tuple(taken), refused=tuple(refused))


class Reloader:
    """Reads the settings again whenever it is asked to, one time after the other.

    Parameters
    ----------
    running : Loaded
        What is in force.
    asked : asyncio.Event
        Set by whoever wants it.
    adopt : callable
        Puts other settings in force.
    notifier : Notifier
        The service manager hears when it begins and how it ends.
    """

    def __init__(
        self, running: Loaded, asked: asyncio.Event, adopt: Callable[[Loaded], None], notifier: Notifier
    ) -> None:
        self._running = running
        self._asked = asked
        self._adopt = adopt
        self._notifier = notifier

    async def run(self) -> None:
        """Serve until cancelled."""
        while True:
            await self._asked.wait()
            self._asked.clear()
            self._notifier.reloading()
            self._notifier.reloaded(await self._once())

    async def _once(self) -> str:
        try:
            found = await asyncio.to_thread(read_again, self._running)
        except (ConfigError, CalibrationError) as error:
            said = f"settings not taken, the old ones stay: {error}"
            _log.error("%s", said)
            return said
        except Exception as error:  # noqa: BLE001  # whatever a file does, a running daemon goes on with what it has
            said = f"settings not taken, the old ones stay: {type(error).__name__}: {error}"
            _log.exception("%s", said)
            return said
        if found.taken:
            self._running = found.loaded
            self._adopt(found.loaded)
        _log.log(logging.WARNING if found.refused else logging.INFO, "%s", found)
        return str(found)


def _differing(old: dict[str, object], new: dict[str, object]) -> Iterator[tuple[str, object, object]]:
    """Keys whose values differ, with both values; None where there is none."""
    for key in [*old, *(key for key in new if key not in old)]:
        if old.get(key) != new.get(key):
            yield key, old.get(key), new.get(key)
