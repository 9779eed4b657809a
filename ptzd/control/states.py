"""The one table of states: which states may follow which event. Nothing else changes the state.

Two rules: an event that has no entry for the present state is an :class:`ImpossibleEvent` and changes nothing; a
handler that ends in a state its entry does not list is a defect and raises before a command leaves the core.
"""

from __future__ import annotations

from enum import StrEnum

from ptzd.control import events as ev


class State(StrEnum):
    """Where the daemon is."""

    STARTING = "STARTING"
    IDLE = "IDLE"
    SCAN = "SCAN"
    MATCH = "MATCH"
    LOCK = "LOCK"
    HOME = "HOME"
    MANUAL = "MANUAL"
    GOTO = "GOTO"
    PATROL = "PATROL"
    FAULT = "FAULT"
    STOPPED = "STOPPED"


class ImpossibleEvent(Exception):
    """An event that cannot happen in this state; names both, and nothing was changed.

    Parameters
    ----------
    state : State
        The present state, or the state a handler wanted to leave for.
    event : Event
        The event at hand.
    """

    def __init__(self, state: State, event: ev.Event) -> None:
        super().__init__(f"{type(event).__name__} cannot happen in {state}")
        self.state = state
        self.event = event


WORKING = frozenset({State.SCAN, State.MATCH, State.LOCK})
"""A request is active exactly in these."""
SERVING = frozenset({State.IDLE, State.HOME, State.MANUAL, State.GOTO, State.PATROL}) | WORKING
"""Both devices are well exactly in these."""
LIVING = SERVING | {State.STARTING, State.FAULT}

_NEXT = frozenset({State.IDLE, State.SCAN, State.MANUAL, State.PATROL})
"""After something ended: the next request starts, a person goes on by hand, a patrol goes on, or nothing waits."""

Table = dict[tuple[State, type[ev.Event]], frozenset[State]]


def _stays(states: frozenset[State], *events: type[ev.Event]) -> Table:
    return {(state, event): frozenset({state}) for state in states for event in events}


def _table() -> Table:
    stopped = _stays(frozenset({State.STOPPED}), *_all_events())
    table = (
        _living()
        | _without_devices()
        | _serving()
        | _idle_and_home()
        | _manual()
        | _goto()
        | _patrol()
        | _scan()
        | _lock()
        | stopped
    )
    for state in SERVING:
        # whatever ends then: a head that is left no time where it is goes home at once
        table[state, ev.DeadlinePassed] |= {State.HOME}
    return table


def _living() -> Table:
    """Everywhere but after the shutdown, where nothing more particular is said below."""
    table = _stays(
        LIVING,
        ev.PayloadRefused,
        ev.UpdateReceived,
        ev.FrameArrived,
        ev.HeadPolled,
        ev.HeadArrived,
        ev.HeadStalled,
        ev.LensAnswered,
        ev.ViewTaken,
        ev.ViewMissed,
        ev.ViewsCompared,
        ev.MatchFinished,
        ev.MatchFailed,
        ev.SettingsChanged,
        ev.HomeAfterAsked,
        ev.RangesAsked,
    )
    for state in LIVING:
        table[state, ev.ShutdownRequested] = frozenset({State.STOPPED})
        table[state, ev.DeviceLost] = frozenset({State.STARTING if state is State.STARTING else State.FAULT})
        table[state, ev.HeadReady] = frozenset({state})
    return table


def _without_devices() -> Table:
    """Nothing begins before both devices are well."""
    table: Table = {}
    for state in (State.STARTING, State.FAULT):
        table[state, ev.DeviceWell] = frozenset({state}) | _NEXT
        table |= _stays(
            frozenset({state}),
            ev.RequestReceived,
            ev.CancelReceived,
            ev.ControlReceived,
            ev.LeaseAsked,
            ev.MoveAsked,
            ev.GotoAsked,
            ev.PatrolAsked,
            ev.PatrolDue,
            ev.ForeignMotion,
            ev.HeadStopped,
            ev.DeadlinePassed,
        )
    return table


def _serving() -> Table:
    """With both devices well, where nothing more particular is said below."""
    table = _stays(SERVING, ev.DeviceWell)
    for state in SERVING:
        dropped = frozenset({state, State.IDLE, State.MANUAL} if state in WORKING else {state})
        table[state, ev.CancelReceived] = dropped
        table[state, ev.ForeignMotion] = dropped | ({State.IDLE} if state is State.HOME else frozenset())
        table[state, ev.ControlReceived] = _NEXT | {state, State.HOME}
        table[state, ev.LeaseAsked] = dropped | {State.IDLE} if state is State.HOME else dropped
        table[state, ev.MoveAsked] = frozenset({state, State.MANUAL} if state in WORKING else {state})
        table[state, ev.HeadStopped] = frozenset({state})
        table[state, ev.RequestReceived] = dropped | {State.SCAN}
        # a head that is at the place already is told so at once, and may be free again
        table[state, ev.GotoAsked] = _NEXT | {state, State.GOTO}
        begins = {State.IDLE: _NEXT, State.HOME: frozenset({State.PATROL})}.get(state, frozenset())
        table[state, ev.PatrolAsked] = table[state, ev.PatrolDue] = begins | {state}
    return table


def _idle_and_home() -> Table:
    """Nobody has the head, or it is on its way home."""
    table: Table = {
        (State.IDLE, ev.LeaseAsked): _NEXT,
        (State.IDLE, ev.HeadStopped): _NEXT | {State.GOTO},
        (State.IDLE, ev.DeadlinePassed): _NEXT | {State.HOME, State.GOTO},
    }
    for ending in (ev.HeadArrived, ev.HeadStalled, ev.DeadlinePassed):
        # what waited for the motor's budget may begin then
        table[State.HOME, ending] = _NEXT | {State.HOME}
    return table


def _manual() -> Table:
    """A person has the head, until he gives it back or his time is over."""
    return {(State.MANUAL, event): _NEXT for event in (ev.LeaseAsked, ev.DeadlinePassed)}


def _goto() -> Table:
    """A place that the head was sent to: over when its while there is, or when somebody else has the head."""
    goto = State.GOTO
    ends = frozenset({goto, State.IDLE, State.MANUAL})
    table: Table = {(goto, event): ends for event in (ev.ForeignMotion, ev.LeaseAsked, ev.MoveAsked)}
    table[goto, ev.RequestReceived] = frozenset({goto})
    for event in (ev.HeadArrived, ev.HeadStalled, ev.DeadlinePassed):
        table[goto, event] = _NEXT | {goto}
    return table


def _patrol() -> Table:
    """The patrol: whatever else is wanted goes before it, and it stands still when it is told to."""
    patrol = State.PATROL
    words = (ev.ForeignMotion, ev.LeaseAsked, ev.PatrolAsked, ev.PatrolDue)
    answers = (ev.HeadArrived, ev.HeadStalled, ev.DeadlinePassed)
    table: Table = {(patrol, event): frozenset({patrol, State.IDLE}) for event in (*words, *answers)}
    table[patrol, ev.ControlReceived] = frozenset({patrol, State.IDLE, State.HOME})
    return table


_LOOKS = (ev.HeadStalled, ev.ViewTaken, ev.ViewMissed, ev.MatchFinished, ev.MatchFailed, ev.DeadlinePassed)
"""What a look leads to, or that it leads to nothing."""


def _scan() -> Table:
    """The views of the arc, and the matches that are still under way behind the last one."""
    ends = _NEXT | {State.SCAN, State.MATCH, State.LOCK}
    table: Table = {(State.SCAN, event): ends for event in _LOOKS}
    table |= {(State.MATCH, event): ends for event in (ev.MatchFinished, ev.MatchFailed, ev.DeadlinePassed)}
    return table


def _lock() -> Table:
    """The target was found: it is kept, or the request is over."""
    return {(State.LOCK, event): _NEXT | {State.LOCK} for event in (*_LOOKS, ev.UpdateReceived)}


def _all_events() -> tuple[type[ev.Event], ...]:
    kinds = (kind for kind in vars(ev).values() if isinstance(kind, type) and issubclass(kind, ev.Event))
    return tuple(kind for kind in kinds if kind not in {ev.Event, ev.Snapshot})


TRANSITIONS: Table = _table()


def transition_arrows() -> list[tuple[State, State, list[str]]]:
    """Arrows of the diagram: from, to, and the events that may cause it; self-loops left out.

    Returns
    -------
    list of (State, State, list of str)
        In the order of the states, events by name.
    """
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), targets in TRANSITIONS.items():
        for target in targets - {state}:
            arrows.setdefault((state, target), []).append(event.__name__)
    order = list(State)
    return [
        (start, end, sorted(arrows[start, end]))
        for start, end in sorted(arrows, key=lambda pair: (order.index(pair[0]), order.index(pair[1])))
    ]


_SPOKEN = {
    ev.RequestReceived: "request",
    ev.UpdateReceived: "update",
    ev.CancelReceived: "cancel",
    ev.ControlReceived: "operator",
    ev.LeaseAsked: "lease",
    ev.MoveAsked: "hand",
    ev.GotoAsked: "goto",
    ev.PatrolAsked: "patrol",
    ev.PatrolDue: "schedule",
    ev.ForeignMotion: "foreign motion",
    ev.HeadArrived: "arrived",
    ev.HeadStalled: "view",
    ev.ViewTaken: "view",
    ev.ViewMissed: "view",
    ev.MatchFinished: "match",
    ev.MatchFailed: "match",
    ev.DeadlinePassed: "deadline",
    ev.HeadStopped: "stopped",
    ev.DeviceWell: "devices well",
    ev.DeviceLost: "device lost",
    ev.ShutdownRequested: "shutdown",
}
"""What an event is called in the diagram; taken, failed and stalled views are all "view"."""


def mermaid() -> str:
    """The state diagram of README, generated from the table.

    Returns
    -------
    str
        A Mermaid ``stateDiagram-v2``; the arrows into FAULT and STOPPED, which come from everywhere, are notes.
    """
    names = {event.__name__: spoken for event, spoken in _SPOKEN.items()}
    lines = ["stateDiagram-v2", "    [*] --> STARTING"]
    for start, end, events in transition_arrows():
        if end not in {State.FAULT, State.STOPPED}:
            lines.append(f"    {start} --> {end}: {', '.join(sorted({names[event] for event in events}))}")
    serving = ", ".join(state for state in State if state in SERVING)
    living = ", ".join(state for state in State if state in LIVING)
    lines += [
        f"    note left of FAULT: device lost leads here from {serving}",
        f"    note right of STOPPED: shutdown leads here from {living}",
        "    STOPPED --> [*]",
    ]
    return "\n".join(lines)
