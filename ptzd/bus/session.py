"""Opening and closing the Zenoh session."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Sequence
from pathlib import Path

import zenoh

from ptzd.bus.decode import MAX_PAYLOAD_BYTES
from ptzd.config import BusSettings
from ptzd.errors import BusError, ConfigError

SILENT_BYTES = 8 * MAX_PAYLOAD_BYTES
"""Longer requests are dropped before they are looked at; between the two limits the sender is told ``too_large``."""
DEFAULTS: dict[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "timestamping/enabled": True,
    "adminspace/enabled": False,
    # The default pool of 16 MiB does not fit into the 8 MiB of locked memory that a service gets.
    "transport/shared_memory/transport_optimization/pool_size": 4 << 20,
    "transport/shared_memory/transport_optimization/messages": ["put"],
    "transport/link/rx/max_message_size": 16 << 20,
    # A stalled subscriber of pictures holds the sender up for this long, in us (measured; the default is 50 ms).
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 5000,
    # Connections that have said nothing: with Zenoh's own 100 for 10 s, as many silent ones lock all others out.
    "transport/unicast/accept_pending": 1000,
    "transport/unicast/accept_timeout": 2000,
    "low_pass_filter": [
        {
            "id": "roi",
            "flows": ["ingress"],
            "messages": ["put", "query"],
            "key_exprs": ["**/roi/**"],
            "size_limit": SILENT_BYTES,
        }
    ],
}
"""What a session without a file of its own is given; ``config/zenoh.json5`` says the same in Zenoh's own form."""

THREADS = "(rx: (worker_threads: 24), net: (worker_threads: 8))"
"""Of Zenoh's receiving and housekeeping threads, of which it has two and one by itself.

Zenoh closes the connection of an app that stopped reading in one of them, and that holds the thread for the 10 s that
the kernel lingers on what was not read: as many such apps as there are threads, and the bus is silent for everybody.
The threads belong to the process: a session of its own for the pictures would share them.
"""


def provide_threads() -> None:
    """Have Zenoh start with `THREADS`; only before the first session of the process, and whoever set it keeps his."""
    os.environ.setdefault("ZENOH_RUNTIME", THREADS)


def daemon_config(settings: BusSettings) -> zenoh.Config:
    """Session settings of the daemon: the file (or the defaults), and on top of it mode, listen and connect.

    Raises
    ------
    ConfigError
        When the file cannot be read, or Zenoh refuses a value.
    """
    config = _base(settings.config_file)
    _insert(config, "mode", settings.mode)
    _insert(config, "listen/endpoints", list(settings.listen))
    _insert(config, "connect/endpoints", list(settings.connect))
    return config


def client_config(connect: Sequence[str], config_file: str | None) -> zenoh.Config:
    """Session settings of an app that talks to a daemon; a file brings certificates and the like.

    Raises
    ------
    ConfigError
        As :func:`daemon_config`.
    """
    config = _base(config_file)
    _insert(config, "mode", "client")
    _insert(config, "listen/endpoints", [])
    _insert(config, "connect/endpoints", list(connect))
    return config


SETTLED_S = 1.0
"""From opening a session until a router has told of the others."""
GONE_WITHIN_S = 15.0
"""A router believes in a killed daemon for its lease, 10 s: one that comes back so soon waits for that."""


async def refuse_a_second(session: zenoh.Session, token: str) -> None:
    """Raise BusError when somebody else shows a rig as alive: two daemons on one head fight over it.

    Only where the session connects to others (a peer that is joined to a router is not told of the tokens there, a
    client is); two that listen on one address are told by Zenoh itself.
    """
    loop = asyncio.get_running_loop()
    end_s = loop.time() + GONE_WITHIN_S
    await asyncio.sleep(SETTLED_S)
    while await asyncio.to_thread(_alive, session, token):
        if loop.time() > end_s:
            rig = token.rpartition("/")[0].rpartition("/")[2]
            raise BusError(
                f"bus: another daemon serves a rig named {rig} there; end it, or give this one another `rig`"
            )
        await asyncio.sleep(SETTLED_S)


def _alive(session: zenoh.Session, token: str) -> bool:
    return any(reply.ok is not None for reply in session.liveliness().get(token, timeout=SETTLED_S))


async def open_session(config: zenoh.Config, culprit: str) -> zenoh.Session:
    """Open a session off the loop.

    Parameters
    ----------
    config : zenoh.Config
        From :func:`daemon_config` or :func:`client_config`.
    culprit : str
        What the message of a failure starts with.

    Raises
    ------
    BusError
        One line with Zenoh's reason and what to do.
    """
    opening = asyncio.ensure_future(asyncio.to_thread(zenoh.open, config))
    try:
        return await asyncio.shield(opening)
    except zenoh.ZError as error:
        raise BusError(f"{culprit}: {_explain(str(error))}") from None
    except asyncio.CancelledError:
        opening.add_done_callback(_close_late)
        raise


async def close_session(session: zenoh.Session) -> None:
    """Close a session off the loop; an exit without it can hang in Zenoh's threads."""
    await asyncio.shield(asyncio.ensure_future(asyncio.to_thread(session.close)))


def _base(config_file: str | None) -> zenoh.Config:
    if config_file is not None:
        if not Path(config_file).is_file():
            raise ConfigError(
                f"bus.config_file: there is no file {config_file}; give a Zenoh JSON5 file or leave it out"
            )
        try:
            return zenoh.Config.from_file(config_file)
        except zenoh.ZError as error:
            raise ConfigError(f"bus.config_file: {config_file}: {_first_reason(str(error))}") from None
    config = zenoh.Config()
    for key, value in DEFAULTS.items():
        _insert(config, key, value)
    return config


def _insert(config: zenoh.Config, key: str, value: object) -> None:
    try:
        config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigError(f"bus: Zenoh does not take {value!r} for {key}: {_first_reason(str(error))}") from None


def _close_late(opening: asyncio.Future[zenoh.Session]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()  # type: ignore[no-untyped-call]  # untyped in the stub


def _explain(text: str) -> str:
    reason = _first_reason(text)
    if "Address already in use" in text:
        return "the address is already in use; end the other process or choose another port in bus.listen"
    if "Unable to connect" in text:
        return "nobody answers there; is the daemon running, is the address right?"
    if "Permission denied" in text:
        return f"{reason}; choose a port above 1023 in bus.listen"
    return f"{reason}; see bus.listen, bus.connect and bus.config_file"


def _first_reason(text: str) -> str:
    """Zenoh's message without the source lines it appends."""
    return " ".join(text.split(" at /", maxsplit=1)[0].split())
