"""Servos that speak packets (Dynamixel, Feetech, LewanSoul), as joints in radians.

The cycle is pipelined: `write` sends the goals and, in the same breath, the request for the state; `read` takes the
answers, which have come in meanwhile. What a read tells is therefore the state right after the last write.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import TracebackType

import numpy as np

from drivers.bus import Array, BusError, Reading
from drivers.calibration import Calibration, load_calibration
from drivers.servos.line import TRIES, Line, Unit
from drivers.servos.port import Port, Wire
from drivers.servos.state import States
from drivers.servos.table import family_of
from retarget.rig import Rig

FASTER = 1.5  # A load may push a servo along: a reading that needs more than this times its top speed is damage.
STEPS, STEP_S = (0.25, 0.5, 0.75, 1.0), 0.1  # shares of the torque as it comes on, and how long each one lasts
SLACK = 0.05  # rad, and so much on top: backlash, and readings that are not taken at even times


class PacketBus:
    """The servos of `rig` at the serial `port`; a `ServoBus`.

    `watchdog_s`: where the servos have a bus watchdog and nothing has come over the wire for so long, they stop and
    hold (they keep torque). `calibration`: of this unit, by default the user's file. `torque_share`, 0 to 1, of what
    the servos can: those that cannot limit their torque give all of it. Raises BusError where the rig has no servos,
    several buses, servos of several families, or limits that a servo as calibrated cannot reach.
    """

    def __init__(
        self,
        rig: Rig,
        port: str | Wire,
        *,
        calibration: Calibration | None = None,
        watchdog_s: float = 0.5,
        torque_share: float = 1.0,
    ) -> None:
        if not 0 < torque_share <= 1:
            raise BusError(f"torque_share {torque_share}; it is above 0 and at most 1")
        family = family_of(rig)
        self.joints = tuple(s.joint for s in rig.servos)
        self._calibration = calibration or load_calibration(rig)
        self._calibration.check_reach(rig)
        self._watchdog_units, self._watchdog_s = 0, math.inf
        if family.watchdog_s is not None:
            unit, most = family.watchdog_s
            if not unit <= watchdog_s <= most * unit:
                raise BusError(f"watchdog_s {watchdog_s}; a servo's bus watchdog takes {unit}…{most * unit:.2f} s")
            self._watchdog_units = math.ceil(watchdog_s / unit)
            self._watchdog_s = self._watchdog_units * unit
        units = [Unit(s.id, s.joint, family.models[s.model.name], s.model.name) for s in rig.servos]
        self._ids = [u.id for u in units]
        self._port = Port(port, rig.buses[0].baud)
        self._line = Line(self._port, family, units)
        turn = {s.id: s.model.ticks_per_turn / (2 * math.pi) for s in rig.servos}
        pace = {s.id: (FASTER * s.model.no_load_speed * turn[s.id], SLACK * turn[s.id]) for s in rig.servos}
        self._states = States(self._line, pace)
        speed = {j.name: j.velocity for j in rig.joints}
        self._speed = {u.id: math.ceil(speed[u.joint] / u.model.speed[1]) for u in units if u.model.speed is not None}
        self._voltage_unit = np.array([u.model.voltage_unit for u in units])
        self._current = [u.model.current or ("", 0.0) for u in units]
        self._share = torque_share
        self._may_be_on = False
        self._left_out: dict[int, Unit] = {}

    def __enter__(self) -> PacketBus:
        self._port.__enter__()
        try:
            self._line.check_models()
            self._states.read_all()
        except BaseException:
            self._port.__exit__()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if self._may_be_on:
                self.torque(False)
        finally:
            self._port.__exit__()

    def read(self) -> Reading:
        """Measure all servos; of those that answer one by one as many as there is time for, in turn."""
        self._states.refresh()
        values = [self._states[i] for i in self._ids]
        amperes = [unit * row.get(name, 0) for (name, unit), row in zip(self._current, values, strict=True)]
        measured = any(name for name, _ in self._current)
        return Reading(
            position=self._calibration.angle([row["present_position"] for row in values]),
            current=np.array(amperes) * self._calibration.direction if measured else np.zeros(0),
            temperature=np.array([row["present_temperature"] for row in values], float),
            voltage=np.array([row["present_input_voltage"] for row in values]) * self._voltage_unit,
        )

    def write(self, goal: Array) -> None:
        """Goal angles (n,) in rad, all servos at once, and the request for what the next `read` takes.

        Raises BusError where the torque is off, and where the bus was silent for longer than the servos' own watchdog
        waits: they have stopped, and take no goal until the torque is switched on anew.
        """
        if not self._states.on:
            raise BusError(f"{self._port.path}: the torque is off: switch it on before writing goals")
        silence = self._port.note_silence()
        if silence > self._watchdog_s:
            raise BusError(f"{self._port.path}: nothing was sent for {silence:.2f} s: the servos stopped themselves")
        ticks = dict(zip(self._ids, self._calibration.ticks(goal).tolist(), strict=True))
        goals = {i: ticks[i] for i in self._line.units}
        self._states.ask(b"".join(self._line.frames("goal_position", goals)))

    def torque(self, on: bool) -> None:
        """All on, holding the pose that they are in, with the servos' watchdog armed; or all off, confirmed by each.

        Where servos can limit their torque it rises in STEPS, which takes 0.3 s.

        Raises BusError naming the joints of servos with a hardware error or that did not do it.
        """
        self._states.reset(on=False)
        if on:
            self._torque_on()
        else:
            self._torque_off()

    def leave_out(self, joint: str) -> None:
        """Let the servo of `joint` go and do without it from now on: it reads as where it was last.

        Raises BusError where it is the only one left.
        """
        if len(self._line.units) == 1:
            raise BusError(f"{self._port.path}: {joint} was the last servo that worked")
        [ident] = [i for i, unit in self._line.units.items() if unit.joint == joint]
        self._line.write("torque_enable", {ident: 0})
        self._left_out[ident] = self._line.units.pop(ident)
        self._states.forget(ident)

    def _torque_on(self) -> None:
        if any(self._line.read("torque_enable").values()):
            self._torque_off()
        self._set_up()
        here = self._line.read("present_position")
        limits = self._torque_limits()
        self._limit_torque(limits, STEPS[0])
        self._may_be_on = True  # On some servos the goal alone switches the torque on.
        self._line.write("goal_position", here)
        for ident, goal in self._line.read("goal_position").items():
            if goal != here[ident]:
                unit = self._line.units[ident]
                raise BusError(f"{unit}: stands at {here[ident]} ticks, outside the limits that the servo is set to")
        self._states.keep("torque_enable", dict.fromkeys(self._ids, 1))
        if off := [i for i, on in self._line.read("torque_enable").items() if not on]:
            raise BusError(f"{self._line.units[off[0]]}: does not switch its torque on")
        self._line.write("bus_watchdog", dict.fromkeys(self._ids, self._watchdog_units))
        self._states.reset(on=True)
        for share in STEPS[1:] if limits else ():
            until = self._port.now() + STEP_S
            while self._port.now() < until:
                self._states.refresh()
            self._limit_torque(limits, share)
        self._port.silence = 0.0

    def _torque_limits(self) -> dict[str, dict[int, int]]:
        """By register and id: how far the torque of those servos may go that can limit it."""
        pairs = dict.fromkeys(u.model.torque for u in self._line.units.values() if u.model.torque is not None)
        return {name: self._line.read(most) for name, most in pairs}

    def _limit_torque(self, limits: Mapping[str, Mapping[int, int]], share: float) -> None:
        for name, most in limits.items():
            self._line.write(name, {i: round(share * self._share * value) for i, value in most.items()})

    def _set_up(self) -> None:
        """What a servo must know before its torque comes on; only written where it says something else."""
        units = self._line.units
        self._line.write("bus_watchdog", dict.fromkeys(self._ids, 0))
        for name in dict.fromkeys(name for u in units.values() for name in u.model.setup):
            wanted = {i: u.model.setup[name] for i, u in units.items() if name in u.model.setup}
            said = self._line.read(name, list(wanted))
            self._line.write(name, {i: value for i, value in wanted.items() if said[i] != value})
        for name in dict.fromkeys(u.model.speed[0] for u in units.values() if u.model.speed is not None):
            self._states.keep(name, {i: s for i, s in self._speed.items() if name in units[i].model.by_name})
        self._states.point()

    def _torque_off(self) -> None:
        self._line.units |= self._left_out
        self._left_out.clear()
        problem = ""
        for _ in range(TRIES):
            try:
                self._line.write("torque_enable", dict.fromkeys(self._ids, 0))
                on = [i for i, on in self._line.read("torque_enable", alerts=False).items() if on]
            except BusError as error:
                problem = str(error)
                continue
            if not on:
                self._may_be_on = False
                return
            problem = f"{self._line.units[on[0]]}: keeps its torque on"
        raise BusError(f"torque off is not confirmed, cut the power: {problem}")
