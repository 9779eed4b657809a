"""Going home: one move, and whatever comes of it, the head is free again."""

from __future__ import annotations

from typing import ClassVar

from ptzd.config import Config
from ptzd.control.activities.activity import Activity, Failure, Over, Step
from ptzd.control.states import State
from ptzd.control.work import Work
from ptzd.model import HeadReading


def home_of(config: Config) -> HeadReading:
    """Where the head rests."""
    return HeadReading(pan_deg=config.home.pan_deg, tilt_deg=config.home.tilt_deg, zoom=config.home.zoom)


def is_there(config: Config, reading: HeadReading | None) -> bool:
    """Whether the head is at home within twice what counts as arrived."""
    home, ptz = home_of(config), config.ptz
    return (
        reading is not None
        and abs(reading.pan_deg - home.pan_deg) <= 2 * ptz.arrival_tolerance_deg
        and abs(reading.tilt_deg - home.tilt_deg) <= 2 * ptz.arrival_tolerance_deg
        and abs(reading.zoom - home.zoom) <= 2 * ptz.zoom_tolerance
    )


class Home(Activity, kw_only=True, tag="home"):
    """The head is on its way to where it rests."""

    state: ClassVar[State] = State.HOME

    def begin(self, work: Work) -> Step:
        """Go there; a home outside the camera's own limits is not gone to."""
        limits, home = work.head.limits, home_of(work.config)
        if limits is None or not limits.contains(home):
            return Over()
        work.move(home)
        return None

    def on_arrived(self, work: Work) -> Step:
        """The head is free."""
        del work
        return Over()

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """It is not tried again: nothing depends on it."""
        del work, failure
        return Over()
