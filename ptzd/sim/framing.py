"""Moves given in the picture: centre, area zoom, steps. The camera uses what it believes of its own lens. Pure."""

from __future__ import annotations

import math

from ptzd.sim.head import MoveBy, MoveTo, Pose
from ptzd.sim.profile import ZOOM_STEPS, Profile

STEP_SHARE = 0.25
"""Share of the picture that one ``move=left`` goes."""
_STEPS: dict[str, tuple[int, int]] = {
    "left": (-1, 0), "right": (1, 0), "up": (0, 1), "down": (0, -1),
    "upleft": (-1, 1), "upright": (1, 1), "downleft": (-1, -1), "downright": (1, -1),
}  # fmt: skip


def believed_magnification(profile: Profile, zoom: float) -> float:
    """Magnification linear in zoom, as VAPIX documents it."""
    return 1 + (zoom - 1) * (profile.max_magnification - 1) / (ZOOM_STEPS - 1)


def believed_tan_half(profile: Profile, zoom: float) -> float:
    """Tangent of half the horizontal field of view that the camera believes in."""
    wide = math.radians(profile.field_angle[1] / 10)
    return math.tan(wide / 2) / believed_magnification(profile, zoom)


def centred(profile: Profile, pose: Pose, point: tuple[float, float], size: tuple[float, float], turn: int) -> MoveTo:
    """Absolute move that brings a point of the picture to its middle.

    Parameters
    ----------
    profile : Profile
    pose : Pose
        Where the camera is now.
    point, size : pair of float
        The point and the size of the picture that it is given in, px.
    turn : int
        How the client turned the picture, deg: 0, 90, 180, 270.
    """
    u, v = point[0] - size[0] / 2, point[1] - size[1] / 2
    for _ in range(turn // 90):
        u, v = v, -u
    width = size[1] if turn in (90, 270) else size[0]
    scale = believed_tan_half(profile, pose.zoom) / (width / 2)
    side = -1.0 if profile.reversed_mount else 1.0
    right, up = side * u * scale, -side * v * scale
    tilt = math.radians(pose.tilt_deg)
    forward = math.cos(tilt) - up * math.sin(tilt)
    height = math.sin(tilt) + up * math.cos(tilt)
    pan_deg = pose.pan_deg + math.degrees(math.atan2(right, forward))
    return MoveTo(pan=_wrap(pan_deg), tilt=math.degrees(math.atan2(height, math.hypot(right, forward))))


def area_zoom(profile: Profile, pose: Pose, percent: float) -> float:
    """Zoom position at which ``100/percent`` of the present field of view fills the picture."""
    wanted = believed_magnification(profile, pose.zoom) * percent / 100
    zoom = 1 + (wanted - 1) * (ZOOM_STEPS - 1) / (profile.max_magnification - 1)
    return min(max(round(zoom), 1), ZOOM_STEPS)


def step(profile: Profile, pose: Pose, name: str, turn: int) -> MoveBy:
    """Relative move of a quarter of the picture's width."""
    x, y = _STEPS[name]
    for _ in range(turn // 90):
        x, y = -y, x
    side = -1 if profile.reversed_mount else 1
    width_deg = math.degrees(2 * math.atan(believed_tan_half(profile, pose.zoom)))
    way_deg = STEP_SHARE * width_deg * side
    return MoveBy(pan=x * way_deg if x else None, tilt=y * way_deg if y else None)


def _wrap(angle_deg: float) -> float:
    return math.remainder(angle_deg, 360.0)
