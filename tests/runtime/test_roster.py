"""What is due is told when it changes, once, whatever the clock does."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from ptzd.control import events as ev
from ptzd.presets import Place, Presets, Stay, Window
from ptzd.runtime.roster import CHECK_S, Roster

PLACES = {"gate": Place(azimuth_deg=0.0, elevation_deg=0.0, hfov_deg=40.0)}
STAYS = (Stay(place="gate", dwell_s=5.0),)


class Wall:
    """A clock that is set by hand, and whoever keeps a schedule by it."""

    def __init__(self) -> None:
        self.now = datetime(2026, 1, 10, 20, 59, 55, tzinfo=UTC)
        self.told: list[tuple[str, str]] = []
        window = Window(patrol="night", begin="22:00", until="06:00")
        self.presets = Presets(places=PLACES, patrols={"night": STAYS}, time_zone="Europe/Berlin", schedule=(window,))
        self.roster = Roster(lambda: self.presets, self._tell, lambda: self.now)

    def _tell(self, event: ev.Event) -> None:
        assert isinstance(event, ev.PatrolDue)
        self.told.append((event.patrol, event.since))

    def look(self, **later: float) -> float:
        self.now += timedelta(**later)
        return self.roster.look()


@pytest.fixture
def wall() -> Wall:
    return Wall()


NIGHT = ("night", "2026-01-10T21:00:00Z")


def test_it_wakes_at_the_change_and_tells_it_once(wall: Wall) -> None:
    assert wall.look() == 5.0
    assert wall.told == []
    assert wall.look(seconds=5) == CHECK_S
    assert wall.look(seconds=10) == CHECK_S
    assert wall.told == [NIGHT]
    wall.look(hours=8)
    assert wall.told == [NIGHT, ("", "")]


def test_a_clock_that_is_set_back_and_forth_is_followed(wall: Wall) -> None:
    wall.look(hours=1)
    wall.look(hours=-2)
    wall.look(hours=3)
    wall.look(days=365)
    assert [patrol for patrol, _ in wall.told] == ["night", "", "night", "night"]
    assert wall.told[0] == wall.told[2] == NIGHT
    assert wall.told[3] == ("night", "2027-01-10T21:00:00Z")


def test_within_a_window_a_leap_changes_nothing(wall: Wall) -> None:
    wall.look(hours=2)
    wall.look(hours=-1)
    wall.look(hours=5)
    assert wall.told == [NIGHT]


def test_other_settings_are_followed(wall: Wall) -> None:
    wall.look(hours=1)
    wall.presets = Presets(places=PLACES, patrols={"night": STAYS})
    assert wall.look() == CHECK_S
    assert wall.told == [NIGHT, ("", "")]
