"""A rig without hardware: an AXIS camera over HTTP, a fisheye stream, a scene, and the truth on a side channel."""
