"""The recorded lock that the recorder's tests write."""

from tests.log.conftest import calibration_text, clock, lock, lock_log, rig, run, settings

__all__ = ["calibration_text", "clock", "lock", "lock_log", "rig", "run", "settings"]
