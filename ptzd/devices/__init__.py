"""Adapters of the cameras: the fisheye from V4L2, HTTP or files, the PTZ over VAPIX."""
