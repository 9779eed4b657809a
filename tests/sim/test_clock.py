import asyncio

import pytest

from ptzd.sim.clock import VirtualClock, WallClock


async def test_virtual_time_passes_only_by_hand_and_wakes_in_order():
    clock, woken = VirtualClock(start_s=10.0), []

    async def sleeper(t_s: float) -> None:
        await clock.sleep_until(t_s)
        woken.append(t_s)

    tasks = [asyncio.create_task(sleeper(t_s)) for t_s in (12.0, 11.0, 30.0)]
    await asyncio.sleep(0)
    clock.advance(5.0)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert woken == [11.0, 12.0]
    tasks[2].cancel()
    clock.advance(100.0)
    await asyncio.gather(*tasks, return_exceptions=True)
    await clock.sleep_until(1.0)
    assert clock.now_s() == 115.0
    with pytest.raises(ValueError, match="backwards"):
        clock.advance(-1.0)


async def test_wall_time_never_wakes_early_and_can_run_faster():
    for rate in (1.0, 20.0):
        clock = WallClock(rate)
        start_s = clock.now_s()
        await clock.sleep_until(start_s + 0.05 * rate)
        assert clock.now_s() - start_s >= 0.05 * rate
