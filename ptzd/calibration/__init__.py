"""From pictures and angles to a calibrated rig, and the file that keeps it."""
