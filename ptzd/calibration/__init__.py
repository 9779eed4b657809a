"""From what was seen at which angles to a calibrated rig, and the file that keeps it: mathematics and forms alone."""
