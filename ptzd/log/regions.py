"""The core's state of schema 3 in the form of schema 4: from a box beside its frame to one region."""

from __future__ import annotations

from typing import Any

Plain = dict[str, Any]

_FLAT = ("box", "frame", "newer_box", "newer_frame")


def of_requests(state: Any) -> Plain:  # noqa: ANN401 - as the log has it
    """Return the state of a snapshot in the form of schema 4.

    Raises
    ------
    KeyError, TypeError
        When it is not as schema 3 has it.
    """
    holder = state["holder"]
    return {
        **state,
        "holder": None if holder is None else _claim(holder),
        "claims": [_claim(claim) for claim in state["claims"]],
    }


def _claim(claim: Plain) -> Plain:
    activity = claim["activity"]
    if "task" not in activity:
        return claim
    task = activity["task"]
    return {**claim, "activity": {**activity, "task": {**task, "request": _request(task["request"])}}}


def _request(request: Plain) -> Plain:
    newer = {"box": request["newer_box"], "frame": request["newer_frame"]} if request.get("newer_box") else None
    region = {"box": request["box"], "frame": request["frame"]}
    return {**{name: value for name, value in request.items() if name not in _FLAT}, "region": region, "newer": newer}
