"""The control queue: who may move the head when several want to. Off in a camera as delivered. Pure, explicit time."""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from ptzd.sim.auth import Role

COOKIE = "ptz_ctl_id"
PRIORITIES = {Role.ADMINISTRATOR: 10, Role.OPERATOR: 30, Role.VIEWER: 50}
"""PTZ.UserCtlQueue; the lower number wins."""
TIMEOUT_S = 60.0


@dataclass(slots=True)
class _Place:
    cookie: str
    priority: int
    since_s: float
    active_s: float
    """Last activity, or for viewers the moment they got the control."""


class ControlQueue:
    """Places in the queue by cookie; the first one is in control.

    Parameters
    ----------
    limit : int
        Most places (CtlQueueLimit).
    """

    def __init__(self, limit: int = 20) -> None:
        self._limit = limit
        self._places: list[_Place] = []

    @staticmethod
    def new_cookie() -> str:
        """A name for a client that has none."""
        return secrets.token_hex(8)

    def request(self, cookie: str, role: Role, t_s: float) -> bool:
        """Take a place or keep it; False when the queue is full. A higher group overtakes the lower ones."""
        self._expire(t_s)
        if self._find(cookie) is None:
            if len(self._places) >= self._limit:
                return False
            place = _Place(cookie, PRIORITIES[role], since_s=t_s, active_s=t_s)
            behind = [number for number, other in enumerate(self._places) if other.priority > place.priority]
            self._places.insert(behind[0] if behind else len(self._places), place)
        return True

    def drop(self, cookie: str, t_s: float) -> None:
        """Give a place up."""
        self._expire(t_s)
        self._places = [place for place in self._places if place.cookie != cookie]
        self._start_first(t_s)

    def control(self, cookie: str, t_s: float) -> bool:
        """Whether this client may move the head now; being asked counts as activity."""
        self._expire(t_s)
        if not self._places or self._places[0].cookie != cookie:
            return False
        if self._places[0].priority != PRIORITIES[Role.VIEWER]:
            self._places[0].active_s = t_s
        return True

    def query(self, cookie: str, t_s: float) -> tuple[int, int]:
        """Place (1: in control, 0: none) and seconds until the control at the latest."""
        self._expire(t_s)
        place = self._find(cookie)
        if place is None:
            return 0, 0
        ahead = self._places.index(place)
        left_s = self._places[0].active_s + TIMEOUT_S - t_s
        return ahead + 1, round(left_s + (ahead - 1) * TIMEOUT_S) if ahead else 0

    def _find(self, cookie: str) -> _Place | None:
        return next((place for place in self._places if place.cookie == cookie), None)

    def _expire(self, t_s: float) -> None:
        while self._places and t_s - self._places[0].active_s >= TIMEOUT_S:
            gone = self._places.pop(0)
            self._start_first(gone.active_s + TIMEOUT_S)

    def _start_first(self, t_s: float) -> None:
        if self._places:
            self._places[0].active_s = max(self._places[0].active_s, t_s)
