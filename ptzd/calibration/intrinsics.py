"""A lens from pictures of a flat board, without a prior (Mei & Rives 2007; Zhang 2000 for the perspective one).

Start: ξ of the model's kind, principal point in the middle, focal length by trying a scale of values, poses by
`plane_pose`. Then a robust bundle over lens and poses, and a verdict on every picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ptzd.calibration.bundle import Problem, Solution, rotations, solve
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED, WIDE_RAD, Lens
from ptzd.calibration.pose import plane_pose
from ptzd.calibration.views import BoardView, Status, ViewVerdict, rms
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.sphere import angle_between, rotation_from_rotvec
from ptzd.geometry.types import Array, CameraModel, Mask

MIN_VIEWS = 4
GOOD_VIEWS = 10
OUTLIER_SHARE = 4.0
"""A picture whose rms is so many times the median one is an outlier."""
OUTLIER_PX = 1.0
"""... and at least this large."""
ALIKE_SHARE = 0.02
"""Boards whose points differ by less, in shares of the picture's width, are the same picture."""
STRAY_SHARE = 8.0
"""A point whose residual is so many times the median one strays: the detector took something else for it."""
STRAYS = 0.15
"""Share of a picture's points that may stray; with more the picture is an outlier."""
MIN_TILT_RAD = math.radians(8.0)
"""Boards that are all parallel to within this leave the focal length open."""
MAX_RAY_SIGMA_RAD = math.radians(0.5)
"""A lens known no better than this is not written."""
_WEAK = {"k1": 1.0, "k2": 1.0, "k3": 1.0, "k4": 1.0, "p1": 0.1, "p2": 0.1}
"""Prior sigmas in px per unit: nothing beside what a picture says, and zero where a long lens says nothing."""
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LensFit:
    """A lens and how well it is known."""

    lens: Lens
    size_px: tuple[int, int]
    values: Array
    covariance: Array
    views: tuple[BoardView, ...]
    """Those that took part."""
    poses: Array
    """``(v, 6)``: rotation vector and translation of every board in the camera's frame."""
    residuals: tuple[Array, ...]
    """Per view, found minus predicted, px."""
    verdicts: tuple[ViewVerdict, ...]
    rms_px: float
    max_angle_rad: float
    """Farthest point off the axis that took part, rad."""

    def camera(self, max_angle_rad: float = WIDE_RAD) -> CameraModel:
        """The camera, valid to an angle."""
        return self.lens.camera(self.values, self.size_px, max_angle_rad)

    def ray_sigma_rad(self) -> float:
        """One sigma of a ray at the points that took part, root mean square, best rotation removed."""
        rays = np.concatenate(
            [in_camera(view.points_m, pose) for view, pose in zip(self.views, self.poses, strict=True)]
        )
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        _, by_lens, by_ray = self.lens.project(self.values, rays)
        basis = _tangents(rays)
        change = -np.linalg.solve(np.einsum("nij,njk->nik", by_ray, basis), by_lens)
        in_space = np.einsum("nij,njp->nip", basis, change)
        turn = turn_derivative(rays)
        solved = np.linalg.lstsq(turn.reshape(-1, 3), in_space.reshape(-1, self.lens.size), rcond=None)[0]
        left = in_space - np.einsum("nij,jp->nip", turn, solved)
        return float(np.sqrt(np.einsum("nip,pq,niq->n", left, self.covariance, left).mean()))


def _tangents(rays: Array) -> Array:
    """Two unit vectors across every ray ``(n, 3, 2)``."""
    helper = np.where(np.abs(rays[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(rays, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(rays, first)], axis=-1)


def turn_derivative(vectors: Array) -> Array:
    """``-[v]×`` ``(n, 3, 3)``: the derivative of a turned vector by the turn."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=1)


def in_camera(points_m: Array, pose: Array) -> Array:
    """Points ``(n, 3)`` of a board in the camera's frame."""
    return points_m @ rotation_from_rotvec(pose[:3]).T + pose[3:]


def board_linearise(lens: Lens, views: Sequence[BoardView]) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """Residuals and derivatives of all points by the lens ``(P,)`` and the boards' poses ``(v, 6)``."""
    counts = [len(view.pixels) for view in views]
    boards = np.concatenate([view.points_m for view in views])
    pixels = np.concatenate([view.pixels for view in views])
    owner = np.repeat(np.arange(len(views)), counts)

    def linearise(values: Array, poses: Array) -> tuple[Array, Array, Array]:
        turned = np.einsum("nij,nj->ni", rotations(poses[:, :3])[owner], boards)
        predicted, by_lens, by_point = lens.project(values, turned + poses[owner, 3:])
        by_pose = np.concatenate([np.matmul(by_point, turn_derivative(turned)), by_point], axis=2)
        return predicted - pixels, by_lens, by_pose

    return linearise


def problem(lens: Lens, views: Sequence[BoardView], *, loss: str = "huber", free: Mask | None = None) -> Problem:
    """The bundle of a lens and its boards."""
    weak = np.array([_WEAK.get(name, math.inf) for name in lens.names])
    return Problem(
        prior_mean=np.zeros(lens.size),
        prior_sigma=weak,
        linearise=board_linearise(lens, views),
        group=np.repeat(np.arange(len(views)), [len(view.pixels) for view in views]),
        free=np.ones(lens.size, bool) if free is None else free,
        local_rotations=(0,),
        loss=loss,
    )


def _start(lens: Lens, views: Sequence[BoardView], size_px: tuple[int, int]) -> tuple[Array, Array]:
    """Focal length by trial, the rest neutral."""
    width, height = size_px
    first = PERSPECTIVE if lens is PERSPECTIVE else UNIFIED
    focals = np.geomspace(0.3, 40.0, 36) if lens is PERSPECTIVE else np.geomspace(0.15, 3.0, 24)
    chosen = views if len(views) <= 15 else [views[i] for i in np.linspace(0, len(views) - 1, 15).astype(int)]
    best, values = math.inf, np.zeros(first.size)
    for focal in (focals * max(size_px)).tolist():
        trial = np.zeros(first.size)
        trial[:4] = focal, focal, (width - 1) / 2, (height - 1) / 2
        if first is UNIFIED:
            trial[4] = 1.0
        score = _score(first, trial, chosen, size_px)
        if score < best:
            best, values = score, trial
    poses = _poses(first, values, views, size_px)
    if lens is first:
        return values, poses
    kept = np.zeros(first.size, bool)
    kept[:2] = kept[4] = True
    solved = solve(problem(first, views, free=kept), values, poses)
    start = np.zeros(lens.size)
    start[:4] = solved.shared[:4]
    start[:2] /= 1.0 + solved.shared[4]
    return start, solved.local


def _poses(lens: Lens, values: Array, views: Sequence[BoardView], size_px: tuple[int, int]) -> Array:
    camera = lens.camera(values, size_px, WIDE_RAD)
    return np.stack([_pose(camera, view) for view in views])


def _pose(camera: CameraModel, view: BoardView) -> Array:
    rays, valid = camera.lift(view.pixels)
    if valid.sum() < 4:
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return plane_pose(view.points_m[valid], rays[valid])


def _score(lens: Lens, values: Array, views: Sequence[BoardView], size_px: tuple[int, int]) -> float:
    try:
        poses = _poses(lens, values, views, size_px)
    except (GeometryError, CalibrationError, np.linalg.LinAlgError):
        return math.inf
    errors = []
    for view, pose in zip(views, poses, strict=True):
        predicted, _, _ = lens.project(values, in_camera(view.points_m, pose))
        errors.append(rms(predicted - view.pixels))
    return float(np.median(errors))


def calibrate_lens(
    views: Sequence[BoardView],
    size_px: tuple[int, int],
    lens: Lens = UNIFIED,
    *,
    held_out: bool = True,
    min_views: int = MIN_VIEWS,
    progress: Progress = lambda text: None,
) -> LensFit:
    """Estimate a lens.

    Parameters
    ----------
    views : sequence of BoardView
        At least ``min_views``, from different places and tilts.
    size_px : (int, int)
        Of all pictures.
    lens : Lens
        Which model.
    held_out : bool
        Also predict every picture without it.
    progress : callable
        Told what is being done.

    Raises
    ------
    CalibrationError
        When the pictures do not determine the lens; the message says which pictures to take.
    """
    _check(views, size_px, min_views)
    progress(f"{lens.name}: first guess of {len(views)} pictures")
    shared, local = _start(lens, views, size_px)
    shared, local = _staged(lens, views, shared, local)
    views = _without_strays(lens, views, shared, local)
    kept = list(range(len(views)))
    outliers: list[ViewVerdict] = []
    while True:
        progress(f"{lens.name}: bundle of {len(kept)} pictures")
        chosen = [views[i] for i in kept]
        solution = solve(problem(lens, chosen), shared, local)
        parts = _split(solution.residuals, chosen)
        errors = np.array([rms(part) for part in parts])
        limit = max(OUTLIER_PX, OUTLIER_SHARE * float(np.median(errors)))
        worst = int(np.argmax(errors))
        if errors[worst] <= limit or len(kept) <= min_views:
            break
        reason = f"rms {errors[worst]:.2f} px against a median of {np.median(errors):.2f} px"
        outliers.append(
            ViewVerdict(name=chosen[worst].name, status=Status.OUTLIER, reason=reason, rms_px=errors[worst])
        )
        del kept[worst]
        shared, local = solution.shared, np.delete(solution.local, worst, axis=0)
    fit = _fit(lens, size_px, chosen, solution, parts, outliers)
    _check_result(fit, len(views))
    return _with_held_out(fit, solution, outliers, progress) if held_out else fit


def _staged(lens: Lens, views: Sequence[BoardView], shared: Array, local: Array) -> tuple[Array, Array]:
    """Free the parameters one after another, strongest first, so that the start may be far."""
    for names in (("fx", "fy"), ("fx", "fy", "cx", "cy"), ("fx", "fy", "cx", "cy", "xi", "k1")):
        free = np.array([name in names for name in lens.names])
        stage = problem(lens, views, loss="cauchy", free=free)
        solution = solve(stage, shared, local)
        shared, local = solution.shared, solution.local
    return shared, local


def _without_strays(lens: Lens, views: Sequence[BoardView], shared: Array, local: Array) -> list[BoardView]:
    """The views without single points that the detector misplaced."""
    solution = solve(problem(lens, views, loss="cauchy"), shared, local)
    lengths = np.linalg.norm(solution.residuals, axis=1)
    limit = max(OUTLIER_PX, STRAY_SHARE * float(np.median(lengths)))
    cleaned = []
    for view, part in zip(views, _split(lengths, views), strict=True):
        good = part <= limit
        few = 0 < (~good).sum() <= STRAYS * len(good)
        cleaned.append(view.only(good) if few else view)
    return cleaned


def _split(residuals: Array, views: Sequence[BoardView]) -> list[Array]:
    return np.split(residuals, np.cumsum([len(view.pixels) for view in views])[:-1])


def _fit(
    lens: Lens,
    size_px: tuple[int, int],
    views: Sequence[BoardView],
    solution: Solution,
    parts: Sequence[Array],
    outliers: Sequence[ViewVerdict],
) -> LensFit:
    used = [
        ViewVerdict(name=view.name, status=Status.USED, reason=view.remark, rms_px=rms(part))
        for view, part in zip(views, parts, strict=True)
    ]
    rays = np.concatenate([in_camera(v.points_m, p) for v, p in zip(views, solution.local, strict=True)])
    return LensFit(
        lens=lens,
        size_px=size_px,
        values=solution.shared,
        covariance=solution.covariance,
        views=tuple(views),
        poses=solution.local,
        residuals=tuple(-part for part in parts),
        verdicts=(*used, *outliers),
        rms_px=rms(solution.residuals),
        max_angle_rad=float(angle_between(rays, np.array([0.0, 0.0, 1.0])).max()),
    )


def _with_held_out(fit: LensFit, solution: Solution, outliers: Sequence[ViewVerdict], progress: Progress) -> LensFit:
    """Leave every picture out in turn, estimate the lens from the others, then only the pose with the left-out one."""
    verdicts = []
    for index, view in enumerate(fit.views):
        progress(f"{fit.lens.name}: without {view.name}")
        others = [other for other in fit.views if other is not view]
        known = solve(problem(fit.lens, others), solution.shared, np.delete(solution.local, index, axis=0)).shared
        fixed = problem(fit.lens, [view], free=np.zeros(fit.lens.size, bool))
        alone = solve(fixed, known, solution.local[index : index + 1])
        before = fit.verdicts[index]
        verdicts.append(replace(before, held_out_rms_px=rms(alone.residuals)))
    return replace(fit, verdicts=(*verdicts, *outliers))


def _check(views: Sequence[BoardView], size_px: tuple[int, int], min_views: int) -> None:
    if len(views) < min_views:
        raise CalibrationError(
            f"pictures: {len(views)} with a board; take at least {GOOD_VIEWS}, with the board in the middle, in all "
            "corners and tilted by 20 to 40 degrees every way"
        )
    first = views[0]
    same = [view for view in views if view.pixels.shape == first.pixels.shape]
    spread = max(float(np.abs(view.pixels - first.pixels).max()) for view in same)
    if len(same) == len(views) and spread < ALIKE_SHARE * size_px[0]:
        raise CalibrationError(
            f"pictures: all alike, the board moves by {spread:.1f} px in all of them; move the board through the whole "
            "picture and tilt it"
        )


def _check_result(fit: LensFit, offered: int) -> None:
    if len(fit.views) < max(MIN_VIEWS, 0.5 * offered):
        names = ", ".join(v.name for v in fit.verdicts if not v.used)
        raise CalibrationError(
            f"pictures: {offered - len(fit.views)} of {offered} contradict the others ({names}); check the board's "
            "size and that all pictures come from one camera, not mirrored"
        )
    normals = np.stack([rotation_from_rotvec(pose[:3])[:, 2] for pose in fit.poses])
    tilt = float(np.arccos(np.clip(np.abs(normals @ normals.T), 0.0, 1.0)).max())
    if tilt < MIN_TILT_RAD:
        raise CalibrationError(
            f"pictures: all boards are parallel to within {math.degrees(tilt):.1f}°, which leaves the focal length "
            "open; tilt the board by 20 to 40 degrees in most pictures"
        )
    limit = 0.01 * max(fit.size_px)
    if fit.rms_px > limit:
        raise CalibrationError(
            f"pictures: the boards fit only to {fit.rms_px:.1f} px; check the board's size (points each way and "
            "pitch), that it is flat, and that the lens did not change"
        )
    sigma = fit.ray_sigma_rad()
    if not sigma <= MAX_RAY_SIGMA_RAD:
        raise CalibrationError(
            f"pictures: rays are known to {math.degrees(sigma):.2f}° only; add pictures with the board near the "
            "border, and tilt the board by 20 to 40 degrees"
        )
