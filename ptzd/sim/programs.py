"""What moves a camera besides its client: the overview, guard tours, another user, recalibration, a knock, a reboot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ptzd.sim.auth import Gate, Role, User
from ptzd.sim.faults import Fault, FaultBox, FaultKind
from ptzd.sim.head import MoveTo
from ptzd.sim.unit import Unit
from ptzd.sim.wire import Network

ANOTHER_USER = User(name="another user", password="")
HEARTBEAT_S = 0.05
"""How often the programs look at the time."""


class Programs:
    """The camera's own programs; :meth:`run` until cancelled.

    Parameters
    ----------
    unit : Unit
    gate : Gate
    faults : FaultBox
        Its faults that happen once are carried out here.
    network : Network
    reboot : Callable
    """

    def __init__(self, unit: Unit, gate: Gate, faults: FaultBox, network: Network, reboot: Callable[[], None]) -> None:
        self._unit = unit
        self._gate = gate
        self._faults = faults
        self._network = network
        self._reboot = reboot
        self._tour_step = 0
        self._tour_due_s = 0.0

    async def run(self) -> None:
        """Look at the time again and again."""
        clock = self._unit.clock
        async with asyncio.TaskGroup() as tasks:
            while True:
                now_s = clock.now_s()
                for fault in self._faults.due(now_s):
                    if fault.kind is FaultKind.RECALIBRATE:
                        tasks.create_task(self._recalibrate(), name="sim recalibration")
                    elif fault.kind is FaultKind.UNPLUG:
                        tasks.create_task(self._network.be_away(fault.for_s), name="sim unplugged")
                    else:
                        self._happen(fault, now_s)
                self._return_to_overview(now_s)
                self._walk_tour(now_s)
                await clock.sleep_until(now_s + HEARTBEAT_S)

    def _happen(self, fault: Fault, now_s: float) -> None:
        match fault.kind:
            case FaultKind.REBOOT:
                self._reboot()
            case FaultKind.FOREIGN_MOVE:
                self._unit.force(MoveTo(pan=fault.pan, tilt=fault.tilt, zoom=fault.zoom), ANOTHER_USER.name)
            case FaultKind.KNOCK:
                self._unit.head.shift_zero(now_s, fault.pan or 0.0, fault.tilt or 0.0)
            case FaultKind.STUCK:
                self._unit.head.stick(now_s)
            case FaultKind.FORGET_NONCES:
                self._gate.forget_nonces()
            case FaultKind.PRESET:
                self._unit.go_preset(self._unit.preset_number(fault.name) or 0, ANOTHER_USER)
            case FaultKind.ROLE:
                role = Role[fault.value.upper()]
                self._gate.appoint(self._unit.settings.user, role, ptz=role > Role.VIEWER)
            case FaultKind.GUESSES:
                self._gate.shut(now_s)
            case FaultKind.PARAMETER:
                self._unit.parameters[fault.name] = fault.value
            case _:
                raise AssertionError(fault.kind)

    def _return_to_overview(self, now_s: float) -> None:
        idle_s = float(self._unit.parameters["PTZ.Various.V1.ReturnToOverview"])
        if idle_s and now_s - self._unit.last_order_s >= idle_s and not self._unit.at_home():
            self._unit.go_home("return to overview")

    def _walk_tour(self, now_s: float) -> None:
        """Guard tour: preset after preset, each for its time."""
        parameters = self._unit.parameters
        if not self._unit.flag("GuardTour.G0.Running"):
            self._tour_step, self._tour_due_s = 0, now_s
            return
        if now_s < self._tour_due_s:
            return
        steps = sum(name.endswith(".PresetNbr") for name in parameters if name.startswith("GuardTour.G0.Tour."))
        step = f"GuardTour.G0.Tour.T{self._tour_step % steps}"
        preset = self._unit.presets.get(int(parameters[f"{step}.PresetNbr"]))
        if preset is not None:
            self._unit.force(MoveTo(pan=preset.pan, tilt=preset.tilt, zoom=preset.zoom), "guard tour", preset=True)
        self._tour_due_s = now_s + float(parameters[f"{step}.WaitTime"])
        self._tour_step += 1

    async def _recalibrate(self) -> None:
        unit, clock = self._unit, self._unit.clock
        before = unit.head.encoder(clock.now_s())
        for pan, tilt in (
            (unit.profile.pan.low, unit.profile.tilt.low),
            (unit.profile.pan.high, unit.profile.tilt.high),
        ):
            unit.force(MoveTo(pan=pan, tilt=tilt, zoom=1), "recalibration")
            while unit.head.busy(clock.now_s()):
                await clock.sleep_until(clock.now_s() + HEARTBEAT_S)
        unit.head.find_zero(clock.now_s())
        unit.force(MoveTo(pan=before.pan_deg, tilt=before.tilt_deg, zoom=before.zoom), "recalibration")
