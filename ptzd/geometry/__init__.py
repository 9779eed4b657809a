"""Sphere, camera models, head, rig, epipolar arc and plane homography; numpy only, radians only."""
