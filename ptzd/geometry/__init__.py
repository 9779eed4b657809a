"""Sphere, camera models, head, rig, epipolar arc and planes; numpy only, radians only."""
