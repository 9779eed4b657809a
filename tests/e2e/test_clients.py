"""The command line as a client of a running daemon, and `ptzd check --connect` on the simulated rig."""

from __future__ import annotations

import asyncio
import json

import pytest

from ptzd.cli import entry


@pytest.fixture
def ask(capsys):
    """Runs a command in a thread of its own; exit code and what it printed."""

    async def run(site, *arguments: str, connect: bool = True) -> tuple[int, str]:
        where = ["--connect", site.endpoint] if connect else []
        code = await asyncio.to_thread(entry, [*arguments, *where])
        return code, capsys.readouterr().out

    return run


async def test_the_clients_of_the_command_line(site, ask) -> None:
    assert await ask(site, "ls") == (0, "demo\n")
    assert await ask(site, "ls", "--json") == (0, '["demo"]\n')

    code, said = await ask(site, "status", "--json")
    status = json.loads(said)
    assert (code, status["state"], status["fisheye"], status["ptz"]) == (0, "IDLE", "well", "well")
    assert status["versions"]["ptzd"]
    assert status["log"]["file"].endswith(".mcap")
    code, said = await ask(site, "status")
    assert code == 0
    assert said.startswith("IDLE")

    box = ",".join(str(value) for value in site.box)
    site.asked.append("one")
    code, said = await ask(site, "aim", box, "--id", "one", "--hold", "0", "--json", "--range", "1,20")
    lines = [json.loads(line) for line in said.splitlines()]
    assert code == 0
    assert lines[-1]["outcome"] == "locked"
    assert {"state", "view", "match", "locked"} <= {line["step"] for line in lines[:-1]}

    assert (await ask(site, "cancel", "one")) == (0, "one: locked\n")
    assert (await ask(site, "home")) == (0, "home\n")
    nothing = "hold: nothing is locked; no request, patrol or way home begins until `release`\n"
    assert (await ask(site, "hold")) == (0, nothing)
    assert (await ask(site, "release")) == (0, "release\n")
    assert (await ask(site, "stop")) == (0, "stopped\n")


async def test_an_aim_that_does_not_end_in_a_lock_exits_with_1(site, ask) -> None:
    site.asked.append("short")
    box = ",".join(str(value) for value in site.box)
    code, said = await ask(site, "aim", box, "--id", "short", "--timeout", "0.2")
    assert code == 1
    assert "short: timeout" in said


async def test_refusals_and_silence_have_their_exit_codes(site, capsys) -> None:
    for arguments, code, told in (
        (["aim", "630,10,20,20"], 65, "picture"),
        (["cancel", "nobody"], 65, "no request nobody"),
        (["status", "--rig", "elsewhere"], 69, "elsewhere"),
        (["status", "--prefix", "other"], 69, "no rig is alive"),
    ):
        assert await asyncio.to_thread(entry, [*arguments, "--connect", site.endpoint]) == code
        said = capsys.readouterr().err
        assert told in said
        assert len(said.splitlines()) == 1


def test_nobody_there_is_one_line(endpoint, capsys) -> None:
    assert entry(["status", "--connect", endpoint]) == 69
    said = capsys.readouterr().err
    assert endpoint in said
    assert len(said.splitlines()) == 1


async def test_check_talks_to_both_cameras(make_site, ask) -> None:
    site = await make_site()
    code, said = await ask(site, "check", "--config", str(site.config), "--connect", connect=False)
    assert code == 0
    assert "limits pan" in said
    assert said.count("as calibrated") == 2
    await site.start()
