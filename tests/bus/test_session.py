from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
import zenoh

from ptzd.bus import session as session_module
from ptzd.bus.server import ZenohBus
from ptzd.bus.session import DEFAULTS, client_config, close_session, daemon_config, open_session
from ptzd.config import BusSettings
from ptzd.errors import BusError, ConfigError

CONFIG = Path(__file__).parents[2] / "config"


async def test_port_in_use_is_one_clear_line(endpoint: str):
    config = daemon_config(BusSettings(listen=(endpoint,)))
    session = await open_session(config, "bus")
    with pytest.raises(BusError) as caught:
        await open_session(daemon_config(BusSettings(listen=(endpoint,))), f"bus: cannot open {endpoint}")
    await close_session(session)
    assert str(caught.value) == (
        f"bus: cannot open {endpoint}: the address is already in use; "
        "end the other process or choose another port in bus.listen"
    )


@pytest.mark.parametrize("listen", ["tcp/127.0.0.1:99999", "tls/127.0.0.1:0", "pigeon/coop:1", "nonsense"])
async def test_bad_endpoint_is_one_clear_line(listen: str):
    with pytest.raises((BusError, ConfigError), match="bus") as caught:
        await open_session(daemon_config(BusSettings(listen=(listen,))), f"bus: cannot open {listen}")
    assert "\n" not in str(caught.value)
    assert ".rs" not in str(caught.value)


async def test_nobody_listening_is_said(endpoint: str):
    with pytest.raises(BusError, match="nobody answers there; is the daemon running"):
        await open_session(client_config([endpoint], None), "bus: cannot connect")


def test_missing_or_broken_file(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"bus\.config_file: there is no file"):
        daemon_config(BusSettings(config_file=str(tmp_path / "none.json5")))
    broken = tmp_path / "broken.json5"
    broken.write_text("{ mode: }")
    with pytest.raises(ConfigError, match=r"broken\.json5") as caught:
        daemon_config(BusSettings(config_file=str(broken)))
    assert "\n" not in str(caught.value)


def test_own_keys_lie_on_top_of_the_file(tmp_path: Path):
    file = tmp_path / "own.json5"
    file.write_text('{mode: "client", listen: {endpoints: ["tcp/0.0.0.0:1"]}, timestamping: {enabled: false}}')
    settings = BusSettings(mode="router", listen=("tcp/127.0.0.1:9",), connect=("tcp/h:1",), config_file=str(file))
    config = daemon_config(settings)
    assert json.loads(config.get_json("mode")) == "router"
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:9"]
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/h:1"]
    assert json.loads(config.get_json("timestamping/enabled")) is False


def test_shipped_file_says_what_the_defaults_say():
    shipped = zenoh.Config.from_file(CONFIG / "zenoh.json5")
    built_in = daemon_config(BusSettings())
    for key in [*DEFAULTS, "mode", "listen/endpoints", "connect/endpoints"]:
        assert json.loads(shipped.get_json(key)) == json.loads(built_in.get_json(key)), key


def test_shipped_tls_file_denies_by_default_and_keeps_the_limits():
    config = daemon_config(BusSettings(config_file=str(CONFIG / "zenoh-tls.json5"), listen=("tls/127.0.0.1:0",)))
    assert json.loads(config.get_json("access_control/default_permission")) == "deny"
    assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True
    for key in DEFAULTS:
        assert json.loads(config.get_json(key)) == json.loads(daemon_config(BusSettings()).get_json(key)), key


async def test_silent_connections_lock_nobody_out(endpoint: str):
    """A client gets in while more of them than Zenoh's own bound are still open."""
    session = await open_session(daemon_config(BusSettings(listen=(endpoint,))), "bus")
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    silent = [socket.create_connection((host, int(port))) for _ in range(150)]
    try:
        client = await open_session(client_config([endpoint], None), "bus")
        for connection in silent:
            connection.setblocking(False)
        with pytest.raises(BlockingIOError):
            silent[-1].recv(1)
        await close_session(client)
    finally:
        for connection in silent:
            connection.close()
        await close_session(session)


@pytest.fixture
def router(endpoint: str):
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield endpoint
    session.close()


async def test_the_second_daemon_of_one_name_says_so_and_ends(router: str, clock, monkeypatch):
    monkeypatch.setattr(session_module, "GONE_WITHIN_S", 1.5)
    settings = BusSettings(mode="client", listen=(), connect=(router,))
    async with ZenohBus(settings, "hall", clock):
        async with ZenohBus(settings, "yard", clock):
            pass
        with pytest.raises(BusError, match="another daemon serves a rig named hall there; end it, or give this one"):
            async with ZenohBus(settings, "hall", clock):
                pass
    async with ZenohBus(settings, "hall", clock):
        pass
