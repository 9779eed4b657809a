"""Snapshots of schema 1 in the form of schema 2: from a state with its special cases to a holder and claims."""

from __future__ import annotations

from typing import Any

Plain = dict[str, Any]

_SERVING = {"IDLE", "SCAN", "MATCH", "LOCK", "HOME"}
_REQUEST, _HOME, _STOP = 20, 0, 50
_KEPT = ("fisheye", "ptz", "frames", "ended", "finished", "published")
_HEAD = ("limits", "reading", "motion", "held", "matches", "moved_ns", "next_id")


def of_states(snapshot: Plain) -> Plain:
    """Return the state of a snapshot's body in the form of schema 2.

    Raises
    ------
    KeyError
        When it is not as schema 1 has it.
    """
    old = snapshot["state"]
    state = old["state"]
    waiting = [_request(request) for request in old["queue"]]
    homing = [] if old["home_at_ns"] is None else [_claim("home", _HOME, {"activity": "home"}, old["home_at_ns"])]
    return {
        **{name: old[name] for name in _KEPT},
        "serving": state in _SERVING,
        "served": state != "STARTING",
        "stopping": state == "STOPPED",
        "head": {**{name: old[name] for name in _HEAD}, "asked": old["head"]},
        "holder": _holder(old, snapshot["t_ns"]),
        "claims": waiting + homing,
    }


def _holder(old: Plain, t_ns: int) -> Plain | None:
    if old["stop_until_ns"] is not None:
        stop = {"activity": "stop", "tokens": old["stop_tokens"], "until_ns": old["stop_until_ns"]}
        return _claim("stop", _STOP, stop)
    active = old["active"]
    if active is None:
        return _claim("home", _HOME, {"activity": "home"}) if old["state"] == "HOME" else None
    task = {"request": active["request"], "rescans": active["rescans"], "views": active["views"]}
    scan, lock = active["scan"], active["lock"]
    if lock is None:
        return _request(active["request"], {"activity": "scan", **(scan or {}), "task": task})
    seen = {"confirmed_ns": t_ns} if lock["confirmed"] and "confirmed_ns" not in lock else {}
    return _request(active["request"], {"activity": "lock", **lock, **seen, "task": task})


def _request(request: Plain, activity: Plain | None = None) -> Plain:
    waits = {"activity": "scan", "task": {"request": request}}
    return _claim(request["id"], _REQUEST + request["priority"], activity or waits)


def _claim(owner: str, rank: int, activity: Plain, from_ns: int | None = None) -> Plain:
    return {"owner": owner, "rank": rank, "activity": activity, "from_ns": from_ns}
