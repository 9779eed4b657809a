"""Windows of the schedule as instants: over midnight, on the nights on which the clock is changed, in every zone."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.presets import DAYS, Window
from ptzd.runtime.calendar import due, instant

BERLIN = ZoneInfo("Europe/Berlin")
SPRING = date(2026, 3, 29)
"""02:00 leaps to 03:00, 01:00 UTC."""
AUTUMN = date(2026, 10, 25)
"""03:00 goes back to 02:00, 01:00 UTC."""
MINUTE = timedelta(minutes=1)


def window(begin: str, until: str, *days: str, patrol: str = "night") -> Window:
    return Window(patrol=patrol, begin=begin, until=until, days=days)


def utc(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def spans(schedule: list[Window], zone: ZoneInfo, start: str, hours: int = 48) -> list[tuple[str, str, str]]:
    """Which patrol is due from when to when, UTC, by asking at every change."""
    now, end = utc(start), utc(start) + timedelta(hours=hours)
    found, begun = [], ""
    while now < end:
        told = due(schedule, zone, now)
        if found and found[-1][2] == "":
            found[-1] = (found[-1][0], found[-1][1], f"{now:%d %H:%M}") if told.since != begun else found[-1]
        if told.patrol and told.since != begun:
            found.append((told.patrol, f"{now:%d %H:%M}", ""))
        begun = told.since
        assert told.changes is None or told.changes > now
        if told.changes is None:
            break
        now = told.changes
    return found


def test_an_evening_and_a_night_over_midnight() -> None:
    schedule = [window("18:00", "20:30", patrol="evening"), window("22:00", "06:00")]
    assert spans(schedule, BERLIN, "2026-01-10T12:00", 24) == [
        ("evening", "10 17:00", "10 19:30"),
        ("night", "10 21:00", "11 05:00"),
    ]


def test_only_on_its_days_which_are_those_it_begins_on() -> None:
    """The tenth of January 2026 is a Saturday."""
    assert spans([window("22:00", "06:00", "sat")], BERLIN, "2026-01-09T12:00", 72) == [
        ("night", "10 21:00", "11 05:00")
    ]


def test_a_whole_day_and_midnight_as_an_end() -> None:
    assert spans([window("00:00", "24:00", "sat")], BERLIN, "2026-01-09T12:00", 72) == [
        ("night", "09 23:00", "10 23:00")
    ]
    assert spans([window("20:00", "00:00", "sat")], BERLIN, "2026-01-09T12:00", 72) == [
        ("night", "10 19:00", "10 23:00")
    ]


@pytest.mark.parametrize(
    ("begin", "until", "told"),
    [
        ("22:00", "06:00", [("night", "28 21:00", "29 04:00")]),
        ("01:30", "03:30", [("night", "29 00:30", "29 01:30")]),
        ("02:15", "04:00", [("night", "29 01:00", "29 02:00")]),
        ("01:00", "02:45", [("night", "29 00:00", "29 01:00")]),
        ("02:15", "02:45", []),
        ("02:00", "03:00", []),
    ],
)
def test_when_the_clock_leaps_forward_what_it_skips_is_the_moment_of_the_leap(begin, until, told) -> None:
    schedule = [window(begin, until, "sat" if begin == "22:00" else "sun")]
    assert spans(schedule, BERLIN, "2026-03-28T12:00", 24) == told


@pytest.mark.parametrize(
    ("begin", "until", "told"),
    [
        ("22:00", "06:00", [("night", "24 20:00", "25 05:00")]),
        ("02:15", "04:00", [("night", "25 00:15", "25 03:00")]),
        ("01:00", "02:45", [("night", "24 23:00", "25 01:45")]),
        ("02:15", "02:45", [("night", "25 00:15", "25 01:45")]),
        ("02:00", "03:00", [("night", "25 00:00", "25 02:00")]),
    ],
)
def test_when_the_clock_goes_back_what_it_shows_twice_begins_the_first_and_ends_the_second_time(
    begin, until, told
) -> None:
    schedule = [window(begin, until, "sat" if begin == "22:00" else "sun")]
    assert spans(schedule, BERLIN, "2026-10-24T12:00", 24) == told


def test_windows_that_meet_inside_the_hour_shown_twice_do_not_both_have_it() -> None:
    schedule = [window("01:00", "02:30", patrol="one"), window("02:30", "05:00", patrol="two")]
    assert spans(schedule, BERLIN, "2026-10-24T22:00", 8) == [
        ("one", "24 23:00", "25 00:30"),
        ("two", "25 00:30", "25 04:00"),
    ]


def test_zones_that_change_by_half_an_hour_or_at_midnight() -> None:
    """Lord Howe goes from 02:00 to 02:30; in Havana the day of the change begins at 01:00."""
    howe = ZoneInfo("Australia/Lord_Howe")
    assert instant(date(2026, 10, 4), 130, howe, last=False) == instant(date(2026, 10, 4), 150, howe, last=False)
    havana = ZoneInfo("America/Havana")
    assert instant(date(2026, 3, 8), 0, havana, last=False) == instant(date(2026, 3, 8), 60, havana, last=False)
    assert instant(date(2026, 3, 8), 30, havana, last=True) == instant(date(2026, 3, 8), 60, havana, last=False)


@settings(max_examples=200, deadline=None)
@given(
    zone=st.sampled_from(
        ["Europe/Berlin", "America/New_York", "Australia/Lord_Howe", "America/Havana", "Asia/Kolkata"]
    ),
    day=st.dates(date(2025, 1, 1), date(2027, 12, 31)),
    begin=st.integers(0, 1439),
    length=st.integers(1, 1439),
    after=st.integers(0, 2 * 1440),
)
def test_the_clock_of_whoever_looks_agrees(zone, day, begin, length, after) -> None:
    """Away from a change, a window is due exactly while the clock shows a time inside it."""
    until = (begin + length) % 1440
    there = ZoneInfo(zone)
    schedule = [window(f"{begin // 60:02}:{begin % 60:02}", f"{until // 60:02}:{until % 60:02}")]
    now = instant(day, 0, there, last=False) + after * MINUTE
    offsets = {(now + hours * timedelta(hours=1)).astimezone(there).utcoffset() for hours in range(-30, 31)}
    told = due(schedule, there, now)
    if len(offsets) == 1:
        shown = now.astimezone(there)
        minute = shown.hour * 60 + shown.minute
        inside = begin <= minute < begin + length or begin <= minute + 1440 < begin + length
        assert bool(told.patrol) == inside
    assert told.changes is not None
    before, then = due(schedule, there, told.changes - MINUTE), due(schedule, there, told.changes)
    assert before.since != then.since


@given(minute=st.integers(0, 1440), day=st.integers(0, 6))
def test_no_schedule_wants_nothing_and_a_week_knows_its_days(minute: int, day: int) -> None:
    now = utc("2026-01-05T00:00") + timedelta(days=day, minutes=minute)
    assert due([], BERLIN, now).changes is None
    shown = now.astimezone(BERLIN)
    name = DAYS[shown.weekday()]
    assert due([window("00:00", "24:00", name)], BERLIN, now).patrol == "night"
    others = [other for other in DAYS if other != name]
    assert due([window("00:00", "24:00", *others)], BERLIN, now).patrol == ""


def test_a_clock_that_leaps_is_answered_by_what_it_shows() -> None:
    """The same schedule, asked at any moment in any order, answers the same: nothing is remembered."""
    schedule = [window("22:00", "06:00")]
    asked = [utc("2026-01-10T20:59"), utc("2026-01-10T21:00"), utc("2026-01-11T04:59"), utc("2026-01-11T05:00")]
    forwards = [due(schedule, BERLIN, now).since for now in asked]
    assert forwards == ["", "2026-01-10T21:00:00Z", "2026-01-10T21:00:00Z", ""]
    assert [due(schedule, BERLIN, now).since for now in reversed(asked)] == forwards[::-1]
