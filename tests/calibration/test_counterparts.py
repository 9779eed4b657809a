"""Models that are not read are named as such, whatever else their files lack."""

from __future__ import annotations

import json

import pytest

from ptzd.calibration.readers import read_foreign
from ptzd.errors import CalibrationError


@pytest.mark.parametrize(
    ("values", "name"),
    [
        (
            {
                "model_type": "scaramuzza",
                "image_width": 640,
                "image_height": 480,
                "poly_parameters": {"p0": -1.5},
                "affine_parameters": {"ac": 1.0},
            },
            "SCA",
        ),
        ({"model_type": "CATA", "mirror_parameters": {"xi": 1.2}}, "CATA"),
        ({"cam0": {"camera_model": "ds", "distortion_model": "none"}}, "ds-none"),
        ({"camera_model": "pinhole", "distortion_model": "fov", "intrinsics": [300.0]}, "pinhole-fov"),
        ({"cam0": {"camera_model": "eucm", "distortion_model": "radtan", "resolution": [640, 480]}}, "eucm-radtan"),
        ({"value0": {"intrinsics": [{"camera_type": "ds", "intrinsics": 3}], "resolution": [[640, 480]]}}, "ds"),
        ({"Camera.type": "Rectified", "Camera.bf": 40.0, "Camera1.fx": 300.0}, "Rectified"),
    ],
    ids=["scaramuzza", "cata", "ds", "fov", "eucm", "basalt", "orb"],
)
def test_a_model_without_counterpart_is_named_before_its_numbers_are_missed(tmp_path, values, name):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(values))
    with pytest.raises(CalibrationError, match=rf"{name}.* has no counterpart"):
        read_foreign(path)


def test_a_model_of_mrcal_without_counterpart_is_named_before_its_numbers_are_missed(tmp_path):
    path = tmp_path / "lens.cameramodel"
    path.write_text("{\n  'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3',\n}\n")
    with pytest.raises(CalibrationError, match=r"SPLINED_STEREOGRAPHIC.* has no counterpart"):
        read_foreign(path)
