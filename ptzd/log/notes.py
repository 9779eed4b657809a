"""What is said in words on the topic ``/log``: ``foxglove.Log``, as viewers list it."""

from enum import IntEnum

from ptzd.log.protobuf import NS

Json = dict[str, object]


class Level(IntEnum):
    """``foxglove.LogLevel``."""

    DEBUG = 1
    INFO = 2
    WARNING = 3
    ERROR = 4


def stamp(t_ns: int) -> Json:
    """Time as these schemas write it."""
    return {"sec": t_ns // NS, "nsec": t_ns % NS}


def log_message(t_ns: int, level: Level, name: str, text: str) -> Json:
    """``foxglove.Log``."""
    return {"timestamp": stamp(t_ns), "level": int(level), "message": text, "name": name, "file": "", "line": 0}
