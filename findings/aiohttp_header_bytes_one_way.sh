#!/usr/bin/env bash
# aiohttp reads header bytes that are not UTF-8 as lone surrogates. Sent back, its C writer leaves them out without a
# word, its Python writer (AIOHTTP_NO_EXTENSIONS=1) raises: the same program sends another header or none.
#
# Where it hurts: HTTP Digest has the client repeat the server's realm and nonce byte by byte. With a realm that holds one
# Latin-1 letter (0xFC) the C writer repeats another realm, and a right password is refused as wrong. HTTP allows such
# bytes (RFC 9110, 5.5, obs-text).
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check 'aiohttp==3.14.1' 2> /dev/null
cat > "$work/show.py" <<'PY'
import asyncio
import os

import aiohttp

seen = []


async def serve(reader, writer):
    try:
        while True:
            seen.append(await reader.readuntil(b"\r\n\r\n"))
            writer.write(b"HTTP/1.1 200 OK\r\nX-Name: S\xfcd\r\nContent-Length: 0\r\n\r\n")
            await writer.drain()
    except (asyncio.IncompleteReadError, ConnectionError):
        writer.close()


async def main():
    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    address = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/"
    async with aiohttp.ClientSession() as session:
        async with session.get(address) as answer:
            name = answer.headers["X-Name"]
        try:
            async with session.get(address, headers={"X-Name": name}):
                sent = next(line for line in seen[-1].split(b"\r\n") if line.startswith(b"X-Name"))
        except UnicodeEncodeError as error:
            sent = type(error).__name__
    server.close()
    writer = "Python" if os.environ.get("AIOHTTP_NO_EXTENSIONS") else "C"
    print(f"aiohttp {aiohttp.__version__}, {writer} writer: read {name!r}, sent back {sent!r}")


asyncio.run(main())
PY
seen=$("$work/venv/bin/python" "$work/show.py" 2> /dev/null; AIOHTTP_NO_EXTENSIONS=1 "$work/venv/bin/python" "$work/show.py" 2> /dev/null)
echo "$seen"
expected="aiohttp 3.14.1, C writer: read 'S\\udcfcd', sent back b'X-Name: Sd'
aiohttp 3.14.1, Python writer: read 'S\\udcfcd', sent back 'UnicodeEncodeError'"
[ "$seen" = "$expected" ]
