from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from ptzd.bus.client import Client
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings
from ptzd.errors import BusError

SHIPPED = Path(__file__).parents[2] / "config" / "zenoh-tls.json5"

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")


def openssl(*arguments: str | Path) -> None:
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """An authority and certificates for the rig, a viewer, an app, an operator, and a stranger's own authority."""
    where = tmp_path_factory.mktemp("tls")
    for authority in ("ca", "strange-ca"):
        openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2",
                "-subj", f"/CN={authority}", "-keyout", where / f"{authority}.key",
                "-out", where / f"{authority}.pem")  # fmt: skip
    (where / "san").write_text("subjectAltName=IP:127.0.0.1,DNS:localhost\n")
    signed = {"rig": "ca", "viewer": "ca", "app": "ca", "operator": "ca", "stranger": "strange-ca"}
    for name, authority in signed.items():
        openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}",
                "-keyout", where / f"{name}.key", "-out", where / f"{name}.csr")  # fmt: skip
        openssl("x509", "-req", "-in", where / f"{name}.csr", "-CA", where / f"{authority}.pem", "-CAkey",
                where / f"{authority}.key", "-CAcreateserial", "-days", "2", "-extfile", where / "san",
                "-out", where / f"{name}.pem")  # fmt: skip
        tls = {
            "root_ca_certificate": str(where / "ca.pem"),
            "connect_private_key": str(where / f"{name}.key"),
            "connect_certificate": str(where / f"{name}.pem"),
            "enable_mtls": True,
        }
        (where / f"{name}.json5").write_text(json.dumps({"transport": {"link": {"tls": tls}}}))
    (where / "rig-daemon.json5").write_text(SHIPPED.read_text().replace("/etc/ptzd/tls", str(where)))
    return where


@pytest.fixture
def endpoint(new_port) -> str:
    return f"tls/127.0.0.1:{new_port()}"


@pytest.fixture
async def bus(folder, endpoint, clock):
    settings = BusSettings(listen=(endpoint,), config_file=str(folder / "rig-daemon.json5"))
    async with ZenohBus(settings, "hall", clock) as opened:
        yield opened


def as_(name: str, folder: Path, endpoint: str) -> Client:
    return Client.open(endpoint, rig="hall", config_file=str(folder / f"{name}.json5"), timeout_s=30)


async def test_a_viewer_sees_but_asks_for_nothing(core, bus, folder, endpoint, result):
    async with as_("viewer", folder, endpoint) as client:
        assert (await client.status()).state == "STARTING"
        assert await client.rigs() == ["hall"]
        async for _ in client.watch():
            break
        with pytest.raises(BusError, match="no ptzd answers"):
            await client.request(box=(1, 2, 9, 9))
        with pytest.raises(BusError, match="no ptzd answers"):
            await client.control("stop")
        with pytest.raises(BusError, match="no ptzd answers"):
            await client.cancel("a")
        await client.update("a", (1, 2, 9, 9))
        await client.status()
    assert core.seen == []


async def test_an_app_asks_but_does_not_operate(core, bus, folder, endpoint, result):
    async with as_("app", folder, endpoint) as client:
        accepted = await client.request(box=(1, 2, 9, 9))
        waiting = client.feedback(accepted.id)
        bus.perform(result(accepted.id))
        assert [step async for step in waiting] == []
        assert await client.cancel(accepted.id) == "cancelled"
        with pytest.raises(BusError, match="no ptzd answers"):
            await client.control("home")
        with pytest.raises(BusError, match="no ptzd answers"):
            await client.log_files()
    assert len(core.seen) == 2


async def test_an_operator_may_everything(core, bus, folder, endpoint):
    async with as_("operator", folder, endpoint) as client:
        assert await client.control("stop") == "stop done"
        await client.request(box=(1, 2, 9, 9))


async def test_strangers_and_the_unencrypted_stay_outside(bus, folder, endpoint):
    for attempt in (
        as_("stranger", folder, endpoint),
        Client.open(endpoint.replace("tls/", "tcp/"), rig="hall", timeout_s=1),
    ):
        with pytest.raises(BusError):
            async with attempt as client:
                await client.status()
