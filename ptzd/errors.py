"""Every exception ptzd raises on purpose.

::

    PtzdError
    ├── ConfigError          a setting is missing, unknown or out of range          (exit 78)
    ├── CalibrationError     a calibration cannot be read or contradicts itself     (exit 78)
    ├── GeometryError        a computation has no answer for these values           (exit 65)
    ├── MatchError           a match could not be done on these pictures            (exit 65)
    ├── RequestRefused       a request from outside is not acceptable               (exit 65)
    ├── BusError             the Zenoh session cannot be opened or nobody answers   (exit 69)
    ├── LogError             a log cannot be read or written                        (exit 65)
    ├── SimulationError      a scene or a simulated device cannot be set up         (exit 65)
    └── DeviceError          a camera does not do what it was asked                 (exit 69)
        ├── DeviceLost       no answer: refused, timed out, unplugged, stalled
        ├── DeviceRefused    an answer that says no: 401, 403, `Error:` in a 200
        └── DeviceGarbled    an answer that cannot be understood

Messages are one line: what, where, with which value, and what to do about it.
"""

from __future__ import annotations


class PtzdError(Exception):
    """Root of the tree.

    Attributes
    ----------
    exit_code : int
        What the command line exits with when this error ends it (sysexits.h).
    """

    exit_code = 70


class ConfigError(PtzdError):
    """A setting is missing, unknown or out of range; the message starts with the path of the culprit."""

    exit_code = 78


class CalibrationError(PtzdError):
    """A calibration cannot be read or contradicts itself; the message starts with the path of the culprit."""

    exit_code = 78


class GeometryError(PtzdError):
    """A computation has no answer for these values."""

    exit_code = 65


class MatchError(PtzdError):
    """A match could not be done on these pictures; the daemon goes on."""

    exit_code = 65


class RequestRefused(PtzdError):
    """A request from outside is not acceptable; nothing has moved.

    Parameters
    ----------
    code : str
        Machine-readable reason, e.g. ``invalid``, ``outside``, ``stale_frame``, ``unknown_id``, ``busy``.
    message : str
        One sentence for a person.
    field : str
        JSON path of the culprit, e.g. ``$.box.w``; ``$`` for the whole message.
    """

    exit_code = 65

    def __init__(self, code: str, message: str, field: str = "$") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field


class BusError(PtzdError):
    """The Zenoh session cannot be opened, or nobody answers on a key."""

    exit_code = 69


class LogError(PtzdError):
    """A log cannot be read or written."""

    exit_code = 65


class SimulationError(PtzdError):
    """A scene or a simulated device cannot be set up."""

    exit_code = 65


class DeviceError(PtzdError):
    """A camera does not do what it was asked."""

    exit_code = 69


class DeviceLost(DeviceError):
    """No answer: connection refused, timed out, unplugged, stalled."""


class DeviceRefused(DeviceError):
    """An answer that says no: 401, 403, or ``Error:`` inside a 200."""


class DeviceGarbled(DeviceError):
    """An answer that cannot be understood."""
