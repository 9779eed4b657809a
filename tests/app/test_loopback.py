import asyncio
import socket

import pytest

from ptzd.app.loopback import reserved_port


def test_nobody_listens_and_nobody_else_gets_the_port():
    with reserved_port() as port, socket.socket() as stranger:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port))
        with pytest.raises(OSError, match="in use"):
            stranger.bind(("127.0.0.1", port))
        with reserved_port() as other:
            assert other != port


async def test_the_server_it_is_meant_for_binds_it_again_and_again():
    with reserved_port() as port:
        for _ in range(3):
            async with await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", port):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                assert await reader.read() == b""
                writer.close()
                await writer.wait_closed()
