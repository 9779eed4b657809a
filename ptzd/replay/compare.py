"""Comparison of commands and results, exact or within a written tolerance."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control.wording import scaled
from ptzd.model import MatchResult


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """What may differ between machines whose arithmetic differs in the last bits.

    Angles are fields whose names end in ``_rad`` or ``_deg``; for them a share of the value would mean nothing.
    """

    deg: float
    """Of every angle, whether its field is in degrees or in radians."""
    absolute: float
    """For everything else: this or the relative one, whichever is larger."""
    relative: float
    rivals: bool = True
    """Whether a match's places after the first count. Where pixels are resampled otherwise, weak peaks come and go."""

    def allows(self, name: str, one: float, other: float) -> bool:
        """Whether two values of a field may stand for each other."""
        if one == other or (math.isnan(one) and math.isnan(other)):
            return True
        if name.endswith("_rad"):
            limit = math.radians(self.deg)
        elif name.endswith("_deg"):
            limit = self.deg
        else:
            limit = max(self.absolute, self.relative * abs(one))
        return abs(one - other) <= limit


EXACT = Tolerance(deg=0.0, absolute=0.0, relative=0.0)
ROUNDING = Tolerance(deg=1e-7, absolute=1e-9, relative=1e-9)
"""Decisions on another machine: products of matrices and ``arctan2`` round elsewhere. Measured with numpy's dispatch
disabled and with OpenBLAS' kernels for Nehalem and Haswell: set points move by up to 2e-14 of their value."""
ACROSS_MACHINES = Tolerance(deg=1e-3, absolute=5e-4, relative=1e-3)
"""Matches computed anew on another machine. OpenCV's warps and convolutions without AVX2 and other OpenBLAS kernels
move, over 50 matches, directions by up to 1.7e-6 rad, scores and planes by 5e-5, the sharpness by 9e-5, corners by
0.002 px; the number of candidates stays. Five times that, so that a real change (0.01° and more) is still seen."""
ACROSS_OPENCV = Tolerance(deg=6e-3, absolute=6e-3, relative=1e-2, rivals=False)
"""Matches computed anew under another OpenCV. `make opencv` replays the golden logs under several versions: from 5.0 to
4.10, 4.12 and 4.13 the best place moves by up to 0.0013°, its score by 0.0012. Five times that."""

KIND: Mapping[type[cmd.Command], tuple[str, ...]] = {
    cmd.MoveHead: ("move_id",),
    cmd.SpareMove: ("move_id",),
    cmd.SteerHead: ("move_id",),
    cmd.SetLens: ("lens_id",),
    cmd.GrabView: ("grab_id",),
    cmd.RunMatch: ("match_id", "request_id", "frame"),
    cmd.PinFrame: ("request_id", "frame"),
    cmd.ReleaseFrames: ("request_id",),
    cmd.ReplyAccepted: ("token", "id", "position"),
    cmd.ReplyRefused: ("token", "code"),
    cmd.ReplyOutcome: ("token", "outcome"),
    cmd.ReplyMove: ("token", "slowed_by"),
    cmd.PublishFeedback: ("id", "step"),
    cmd.PublishResult: ("id", "outcome"),
    cmd.PublishStatus: ("state", "active", "phase", "queue"),
}
"""What makes a command another one. Where kinds differ, the world would have answered otherwise from there on."""
NUMBER_OF_PLACES = "PublishFeedback.detail.candidates"
"""Told to clients, decides nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something that is not as recorded."""

    sequence: int
    """Of the event that was answered."""
    path: str
    recorded: str
    replayed: str
    event: str = ""
    """Its type."""
    request: str = ""
    """Empty outside of any."""
    parts: bool = False
    """Whether another kind of decision was taken: what was recorded afterwards no longer fits this request."""

    def __str__(self) -> str:
        event = f" ({self.event})" if self.event else ""
        what = "" if self.parts else f"{self.path}: "
        return f"event {self.sequence}{event}: {what}recorded {self.recorded}, replayed {self.replayed}"


def kind(command: cmd.Command | None) -> str:
    """Type of a command with what makes it another one, as text."""
    if command is None:
        return "nothing"
    values = (getattr(command, name) for name in KIND.get(type(command), ()))
    return " ".join([type(command).__name__, *(str(value) for value in values)])


def differences(path: str, recorded: object, replayed: object, tolerance: Tolerance) -> list[tuple[str, str, str]]:
    """Compare two values of dataclasses, tuples, dicts and plain values.

    The time that a match took is passed over: no decision looks at it.

    Returns
    -------
    list of (path, recorded, replayed)
        Empty when equal within the tolerance.
    """
    if not tolerance.rivals and isinstance(recorded, MatchResult) and isinstance(replayed, MatchResult):
        recorded, replayed = _with_best_only(recorded), _with_best_only(replayed)
    one, other = _parts(recorded), _parts(replayed)
    if one is not None and other is not None and type(recorded) is type(replayed) and one.keys() == other.keys():
        return [
            found
            for name, value in one.items()
            for found in differences(f"{path}{name}", value, other[name], tolerance)
        ]
    if not tolerance.rivals and path == NUMBER_OF_PLACES:
        return []
    if isinstance(recorded, float) and isinstance(replayed, float | int):
        name = path.rpartition(".")[2].partition("[")[0]
        same = tolerance.allows(name, recorded, replayed)
    else:
        same = bool(recorded == replayed)
    return [] if same else [(path, _shown(recorded), _shown(replayed))]


def named_path(path: str, *, metric: bool) -> str:
    """The path with a range named by its unit: of a rig without scale none ends in ``_m``."""
    head, dot, name = path.rpartition(".")
    field, bracket, index = name.partition("[")
    (unit,) = scaled({field: None}, metric=metric)
    return f"{head}{dot}{unit}{bracket}{index}"


def _with_best_only(result: MatchResult) -> MatchResult:
    return dataclasses.replace(result, candidates=result.candidates[:1])


def _parts(value: object) -> dict[str, object] | None:
    """Members of a composed value by what their paths add; None of a plain one."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
        if isinstance(value, MatchResult):
            names.remove("elapsed_ms")
        return {f".{name}": getattr(value, name) for name in names}
    if isinstance(value, dict):
        return {f".{key}": item for key, item in value.items()}
    if isinstance(value, tuple | list):
        return {f"[{index}]": item for index, item in enumerate(value)}
    return None


def _shown(value: object) -> str:
    text = type(value).__name__ if dataclasses.is_dataclass(value) else repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"
