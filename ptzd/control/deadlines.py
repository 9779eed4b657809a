"""When the core wants to be woken: armed exactly while something is under way or waits for its time."""

from __future__ import annotations

from ptzd.control import lock
from ptzd.control.memory import Memory
from ptzd.control.states import State
from ptzd.control.work import Work


def next_deadline_ns(work: Work) -> int | None:
    """Earliest of all deadlines, ns; None when nothing can time out."""
    memory = work.memory
    if memory.finished:
        return None
    wanted = [memory.stop_until_ns, *_of_work(memory), *_of_requests(work), *_of_homing(memory)]
    return min((deadline for deadline in wanted if deadline is not None), default=None)


def _of_work(memory: Memory) -> list[int | None]:
    head = [] if memory.head is None else [memory.head.until_ns]
    return [*head, *(match.until_ns for match in memory.matches)]


def _of_requests(work: Work) -> list[int | None]:
    active = work.memory.active
    wanted: list[int | None] = [request.expires_ns for request in work.memory.queue]
    if active is None:
        return wanted
    if active.lock is None or active.lock.locked_ns is None:
        wanted.append(active.request.expires_ns)
    else:
        wanted.append(lock.hold_ends_ns(work, active))
    if active.lock is not None:
        wanted.append(active.lock.verify_ns)
    return wanted


def _of_homing(memory: Memory) -> list[int | None]:
    waits = memory.state is State.IDLE and memory.stop_until_ns is None
    return [memory.home_at_ns] if waits else []
