import cv2
import numpy as np

from ptzd.matching.corners import harris_corners


def squares() -> np.ndarray:
    picture = np.full((120, 160), 60.0, np.float32)
    picture[30:60, 40:80] = 180
    return cv2.GaussianBlur(picture, (0, 0), 1.0)


def test_corners_of_a_square_are_found_to_a_fraction_of_a_pixel():
    found = harris_corners(squares(), 10, 1.0)
    assert len(found) == 4
    for corner in ((39.5, 29.5), (79.5, 29.5), (79.5, 59.5), (39.5, 59.5)):
        assert np.linalg.norm(found - corner, axis=1).min() < 2.0


def test_the_strongest_come_first_and_no_more_than_asked():
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(100, 40, (100, 100)).astype(np.float32), (0, 0), 1.5)
    many = harris_corners(noise, 1000, 1.0)
    few = harris_corners(noise, 5, 1.0)
    assert len(many) > 20
    assert np.array_equal(few, many[:5])


def test_flat_pictures_and_gaps_have_no_corners():
    assert len(harris_corners(np.full((40, 40), 7.0, np.float32), 10, 1.0)) == 0
    gappy = np.full((40, 40), np.nan, np.float32)
    assert len(harris_corners(gappy, 10, 1.0)) == 0
