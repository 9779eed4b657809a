"""What one would reach for otherwise: SIFT and ORB with a homography, template matching, ECC. Same regions, same views.

All get a patch rectified to the view's own angular resolution and orientation, which the calibration allows.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from ptzd.geometry.sphere import normalise
from ptzd.model import HeadReading
from tests.bench.cases import Case

LEAST_INLIERS = 8
RATIO = 0.8
TEMPLATE_FOUND = 0.7
"""Correlation from which a template's best place counts as found."""

Answer = tuple[np.ndarray | None, float]
"""Direction in the head frame, and how good it is."""


def rectified(case: Case, reading: HeadReading) -> tuple[np.ndarray, np.ndarray]:
    """The region as a pinhole of the view's focal length, turned like the view, would see it; and its mask."""
    rig = case.rig
    focal = rig.camera(reading).fx
    ray, _ = rig.fisheye.lift(np.array(case.box.centre))
    turned = rig.head_from_fisheye_rotation @ ray
    forward = turned / np.linalg.norm(turned)
    camera = rig.head_from_camera(reading)
    right = camera[:, 0] - forward * (camera[:, 0] @ forward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    corners, seen = rig.fisheye.lift(np.array(case.box.corners))
    local = corners[seen] @ rig.head_from_fisheye_rotation.T @ axes
    reach = np.abs(local[:, :2] / local[:, 2:]).max(axis=0) * focal
    half = np.minimum(np.ceil(reach), 300).astype(int)
    grid = np.stack(np.meshgrid(np.arange(-half[0], half[0] + 1), np.arange(-half[1], half[1] + 1)), axis=-1)
    rays = np.concatenate([grid / focal, np.ones((*grid.shape[:2], 1))], axis=-1) @ axes.T
    pixels, valid = rig.fisheye.project(rays @ rig.head_from_fisheye_rotation)
    x, y = pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)
    box = case.box
    inside = valid & (x >= box.x) & (x <= box.x + box.w) & (y >= box.y) & (y <= box.y + box.h)
    return cv2.remap(case.fisheye, x, y, cv2.INTER_CUBIC), inside.astype(np.uint8) * 255


def features(detector: cv2.Feature2D, norm: int, case: Case, reading: HeadReading, view: np.ndarray) -> Answer:
    patch, mask = rectified(case, reading)
    own, own_descriptors = detector.detectAndCompute(patch, cv2.dilate(mask, np.ones((9, 9), np.uint8)))
    others, descriptors = detector.detectAndCompute(view, None)
    if own_descriptors is None or descriptors is None or len(own) < 4 or len(others) < 4:
        return None, 0.0
    pairs = cv2.BFMatcher(norm).knnMatch(own_descriptors, descriptors, k=2)
    good = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance]
    if len(good) < 4:
        return None, 0.0
    source = np.array([own[m.queryIdx].pt for m in good])
    target = np.array([others[m.trainIdx].pt for m in good])
    homography, inliers = cv2.findHomography(source, target, cv2.USAC_MAGSAC, 3.0)
    if homography is None:
        return None, 0.0
    centre = homography @ np.array([(patch.shape[1] - 1) / 2, (patch.shape[0] - 1) / 2, 1.0])
    return lifted(case, reading, centre[:2] / centre[2]), float(inliers.sum()) / LEAST_INLIERS


def lifted(case: Case, reading: HeadReading, pixel: np.ndarray) -> np.ndarray:
    rays, _ = case.rig.camera(reading).lift(pixel)
    return normalise(case.rig.head_from_camera(reading) @ rays)


def template(case: Case, reading: HeadReading, view: np.ndarray) -> Answer:
    direction, quality, _ = _template(case, reading, view)
    return direction, quality / TEMPLATE_FOUND


def _template(case: Case, reading: HeadReading, view: np.ndarray) -> tuple[np.ndarray | None, float, tuple[int, int]]:
    patch, _ = rectified(case, reading)
    if patch.shape[0] >= view.shape[0] or patch.shape[1] >= view.shape[1]:
        return None, 0.0, (0, 0)
    response = cv2.matchTemplate(view, patch, cv2.TM_CCOEFF_NORMED)
    response[~np.isfinite(response)] = -1.0
    _, quality, _, place = cv2.minMaxLoc(response)
    centre = np.array([place[0] + (patch.shape[1] - 1) / 2, place[1] + (patch.shape[0] - 1) / 2])
    return lifted(case, reading, centre), quality, place


def ecc(case: Case, reading: HeadReading, view: np.ndarray) -> Answer:
    """Template matching, then ECC of a homography from there."""
    direction, quality, place = _template(case, reading, view)
    if direction is None:
        return None, 0.0
    patch, _ = rectified(case, reading)
    warp = np.array([[1, 0, place[0]], [0, 1, place[1]], [0, 0, 1]], np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4)
    try:
        quality, warp = cv2.findTransformECC(patch, view, warp, cv2.MOTION_HOMOGRAPHY, criteria, None, 5)
    except cv2.error:
        return direction, quality / TEMPLATE_FOUND
    centre = warp @ np.array([(patch.shape[1] - 1) / 2, (patch.shape[0] - 1) / 2, 1.0])
    return lifted(case, reading, centre[:2] / centre[2]), quality / TEMPLATE_FOUND


def over_views(one: Callable[[Case, HeadReading, np.ndarray], Answer]) -> Callable[[Case], dict[str, object]]:
    def run(case: Case) -> dict[str, object]:
        start = time.process_time_ns()
        answers = [one(case, reading, view) for reading, view in case.views]
        spent = (time.process_time_ns() - start) / 1e6 / len(case.views)
        direction, quality = max(answers, key=lambda answer: answer[1])
        return {"direction": direction, "found": quality >= 1.0, "ms": spent, "score": quality}

    return run


_SIFT = cv2.SIFT_create()
_ORB = cv2.ORB_create(2000, fastThreshold=5, edgeThreshold=15, patchSize=15)

PEERS: dict[str, Callable[[Case], dict[str, object]]] = {
    "sift": over_views(lambda case, reading, view: features(_SIFT, cv2.NORM_L2, case, reading, view)),
    "orb": over_views(lambda case, reading, view: features(_ORB, cv2.NORM_HAMMING, case, reading, view)),
    "template": over_views(template),
    "ecc": over_views(ecc),
}
