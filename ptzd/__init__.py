"""ptzd points an AXIS PTZ camera at what a fisheye camera sees."""

__version__ = "0.1.0"
