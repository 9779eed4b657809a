#!/usr/bin/env bash
# Zenoh (Python): a publisher is told that somebody matches it because of a subscriber of its own session that asked for
# samples of others only (allowed_origin=Locality.REMOTE). Nothing it puts is ever delivered there.
#
# Where it hurts: "make the picture only when somebody listens", asked of matching_status, makes it for nobody as soon as
# the same program listens to a wildcard over its own keys.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check 'eclipse-zenoh==1.10.2' 2> /dev/null
cat > "$work/show.py" <<'PY'
import threading

import zenoh

config = zenoh.Config()
for key, value in (("mode", '"peer"'), ("scouting/multicast/enabled", "false"), ("listen/endpoints", "[]")):
    config.insert_json5(key, value)
heard = []
marked = threading.Event()


def take(sample):
    heard.append(bytes(sample.payload))
    marked.set()


with zenoh.open(config) as session:
    publisher = session.declare_publisher("demo/image")
    print("nobody listens:            matching", publisher.matching_status.matching)
    far = session.declare_subscriber("demo/**", take, allowed_origin=zenoh.Locality.REMOTE)
    print("own listener, REMOTE only: matching", publisher.matching_status.matching)
    publisher.put(b"picture")
    near = session.declare_subscriber("demo/mark", lambda sample: marked.set())
    session.put("demo/mark", b"after it")
    marked.wait(10)
    print("delivered to it:          ", len(heard))
    far.undeclare()
    print("undeclared again:          matching", publisher.matching_status.matching)
PY
seen=$("$work/venv/bin/python" "$work/show.py")
echo "eclipse-zenoh 1.10.2"
echo "$seen"
[ "$seen" = "nobody listens:            matching False
own listener, REMOTE only: matching True
delivered to it:           0
undeclared again:          matching False" ]
