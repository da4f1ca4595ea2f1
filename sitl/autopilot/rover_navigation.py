"""Rover's modes that go somewhere: AUTO, LOITER, RTL, GUIDED.

Source: ArduPilot's ``Rover/mode_auto``, ``mode_loiter``, ``mode_rtl`` and ``mode_guided``, as they are for boats.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sitl.autopilot.autopilot import INFO, NOTICE, WARNING, Autopilot
from sitl.autopilot.mission import Command, MissionItem, Progress
from sitl.autopilot.mode import Mode, WayReport
from sitl.autopilot.rover_helm import Helm
from sitl.autopilot.rover_waypoints import RoverWaypoints

__all__ = ["AutoMode", "GuidedTarget", "LoiterMode", "RoverGuidedMode", "RtlMode"]

_STABILIZE, _GUIDED = 16, 8
_TARGET_TIMEOUT_MS = 3000
_SCURVES_IN_GUIDED = 64
"""GUID_OPTIONS, bit 6."""
_DONE_LOITER, _DONE_ACRO, _DONE_MANUAL = 1, 2, 3
"""MIS_DONE_BEHAVE; 0 stops."""
_ACRO, _MANUAL = 1, 0


class _NavigationMode(Mode):
    flags = _STABILIZE | _GUIDED
    needs_position = True

    def __init__(self, owner: Autopilot, helm: Helm) -> None:
        self._owner, self._helm = owner, helm

    @property
    def _waypoints(self) -> RoverWaypoints:
        return self._helm.waypoints

    def _way(self) -> WayReport:
        w = self._waypoints
        return WayReport(w.destination, w.distance, w.bearing, w.wanted_heading, w.cross_track)

    def _loiter_report(self) -> WayReport:
        loiter = self._helm.loiter
        return WayReport(loiter.destination, loiter.distance, loiter.bearing, 0.0, 0.0)


class LoiterMode(_NavigationMode):
    """Stays here."""

    number, name = 5, "LOITER"

    def enter(self) -> None:
        """Stay where the boat would come to rest."""
        self._helm.loiter.start()

    def run(self) -> None:
        """Drive back to the place when it has drifted away."""
        self._helm.loiter.run()

    def report(self) -> WayReport:
        """Return the way to the place."""
        return self._loiter_report()


class RtlMode(_NavigationMode):
    """Drives home with RTL_SPEED (0: WP_SPEED) and stays there."""

    number, name = 11, "RTL"
    arms = False

    def __init__(self, owner: Autopilot, helm: Helm) -> None:
        super().__init__(owner, helm)
        self._loitering = False

    def refusal(self) -> str | None:
        """Home must be known."""
        return None if self._owner.home is not None else "Flight mode change failed"

    def enter(self) -> None:
        """Set out."""
        assert self._owner.home is not None
        self._waypoints.start(max(self._owner.parameters["RTL_SPEED"], 0.0))
        self._waypoints.go(self._owner.ms, self._owner.home)
        self._loitering = False

    def run(self) -> None:
        """Drive home, then stay."""
        if not self._waypoints.reached:
            self._helm.navigate()
            return
        if not self._loitering:
            self._loitering = True
            self._owner.say(INFO, "Reached destination")
            self._helm.loiter.start()
        self._helm.loiter.run()

    def report(self) -> WayReport:
        """Return the way home."""
        return self._way()

    def set_speed(self, speed: float) -> bool:
        """Take a new speed limit [m/s]."""
        return self._waypoints.set_speed(speed)


class AutoMode(_NavigationMode):
    """Flies the mission. ``_carry_out`` is what it does just now; boats loiter until they start and where they wait."""

    number, name = 10, "AUTO"
    in_mission = True

    def __init__(self, owner: Autopilot, helm: Helm, rtl: RtlMode) -> None:
        super().__init__(owner, helm)
        self._rtl = rtl
        self._carry_out: Callable[[], None] = helm.stop
        self._waiting = False
        self._announced = False
        self._wait_s = 0
        self._since_ms = 0
        self._seen: tuple[int, int, tuple[MissionItem, ...]] = (0, 0, ())

    def refusal(self) -> str | None:
        """There must be a mission in addition to home."""
        if len(self._owner.mission.items) > 1:
            return None
        self._owner.say(NOTICE, "No Mission. Can't set AUTO.")
        return "Flight mode change failed"

    def enter(self) -> None:
        """Wait here; the mission starts or goes on with the next loop."""
        self._waypoints.start()
        self._loiter()
        self._waiting = True

    def leave(self) -> None:
        """Stop the mission where it is."""
        self._owner.mission.stop()

    def run(self) -> None:
        """Carry out the present command."""
        mission = self._owner.mission
        if self._waiting:
            self._waiting = False
            if self._owner.parameters["MIS_RESTART"] == 1.0:
                mission.start(self)
            else:
                mission.resume(self)
            self._has_changed()
        elif self._has_changed() and mission.progress is Progress.RUNNING and self._carry_out == self._drive:
            restarted = mission.set_current(mission.current, self)
            how = "changed, restarted command" if restarted else "changed but failed to restart command"
            self._owner.say(WARNING, f"Auto mission {how}")
        else:
            mission.update(self)
        self._carry_out()

    def report(self) -> WayReport | None:
        """Return the way to the present destination."""
        if self._carry_out == self._helm.stop:
            return None
        return self._loiter_report() if self._carry_out == self._helm.loiter.run else self._way()

    def set_speed(self, speed: float) -> bool:
        """Take a new speed limit [m/s]; a boat that loiters does not."""
        return self._carry_out != self._helm.loiter.run and self._waypoints.set_speed(speed)

    # -- the mission's crew

    def start(self, index: int, item: MissionItem) -> bool:
        """Start a command."""
        self._owner.say(INFO, f"Mission: {index} {item.command.label}")
        if item.command is Command.CHANGE_SPEED:
            speed = item.parameters[1]
            if self.set_speed(speed):
                self._owner.say(INFO, f"speed: {speed:.1f} m/s")
            return True
        if item.command is Command.RETURN_TO_LAUNCH:
            if self._rtl.refusal() is None:
                self._rtl.enter()
                self._carry_out = self._rtl.run
            return True
        self._announced = False
        self._wait_s = max(int(item.parameters[0]), 0) if item.command is not Command.LOITER_UNLIMITED else 0
        stops = item.command is not Command.WAYPOINT or self._wait_s > 0
        following = None if stops else self._owner.mission.next_after(index)
        place = self._owner.estimate.place if item.place is None else item.place
        next_place = None if following is None else (place if following.place is None else following.place)
        self._waypoints.go(self._owner.ms, place, next_place)
        self._carry_out = self._drive
        return True

    def verify(self, index: int, item: MissionItem) -> bool:
        """Return whether a command is done, and report it."""
        done = item.command is Command.CHANGE_SPEED or self._has_arrived(index, item)
        if done:
            self._owner.reached_items.append(index)
        return done

    def finish(self) -> None:
        """Act on MIS_DONE_BEHAVE."""
        self._owner.say(NOTICE, "Mission Complete")
        behaviour = int(self._owner.parameters["MIS_DONE_BEHAVE"])
        self._carry_out = self._helm.stop
        if behaviour == _DONE_LOITER:
            self._loiter()
        elif behaviour in (_DONE_ACRO, _DONE_MANUAL):
            self._owner.set_mode(_ACRO if behaviour == _DONE_ACRO else _MANUAL)

    def _has_arrived(self, index: int, item: MissionItem) -> bool:
        if item.command is Command.RETURN_TO_LAUNCH:
            return self._waypoints.reached
        if self._carry_out == self._drive and not self._waypoints.reached:
            return False
        if not self._announced:
            self._announced, self._since_ms = True, self._owner.ms
            wait = f". Loiter for {self._wait_s} seconds" if self._wait_s else ""
            self._owner.say(INFO, f"Reached waypoint #{index}{wait}")
        waited = (self._owner.ms - self._since_ms) // 1000 >= self._wait_s
        return waited and item.command is not Command.LOITER_UNLIMITED

    def _drive(self) -> None:
        """Drive on; a boat stays at a waypoint that it does not round."""
        if self._waypoints.reached and not self._waypoints.blends:
            self._loiter()
        else:
            self._helm.navigate()

    def _loiter(self) -> None:
        self._helm.loiter.start()
        self._carry_out = self._helm.loiter.run

    def _has_changed(self) -> bool:
        """Return whether the next three commands have been changed under the present one."""
        mission, before = self._owner.mission, self._seen
        if (mission.version, mission.current) == before[:2]:
            return False
        coming = tuple(item for item in mission.items[max(mission.current, 1) :] if item.command.navigates)[:3]
        self._seen = mission.version, mission.current, coming
        return mission.current == before[1] and coming != before[2]


@dataclass(frozen=True, slots=True)
class GuidedTarget:
    """A demanded speed [m/s] with a heading [rad] or, if that is None, a turn rate [rad/s]; ``ms``: its time."""

    ms: int
    speed: float
    heading: float | None
    rate: float = 0.0


class RoverGuidedMode(_NavigationMode):
    """Follows targets from the ground. A speed lasts 3 s, then the boat stays; a place lasts until it is reached."""

    number, name = 15, "GUIDED"

    def __init__(self, owner: Autopilot, helm: Helm) -> None:
        super().__init__(owner, helm)
        self.target: GuidedTarget | None = None
        self._goes = False
        self._tells = False

    def enter(self) -> None:
        """Stay here until the first target comes."""
        self._stay()
        self._waypoints.start()
        self._tells = False

    def run(self) -> None:
        """Follow the target, or stay."""
        if self._goes:
            self._run_to_place()
        elif self.target is None:
            self._helm.loiter.run()
        elif self._owner.ms - self.target.ms > _TARGET_TIMEOUT_MS:
            self._owner.say(WARNING, "target not received last 3secs, stopping")
            self._stay()
        else:
            self._follow(self.target)

    def follow(self, target: GuidedTarget) -> None:
        """Follow a speed from now on."""
        self.target, self._goes = target, False

    def go(self, place: complex) -> None:
        """Drive to *place* [m]."""
        if int(self._owner.parameters["GUID_OPTIONS"]) & _SCURVES_IN_GUIDED:
            self._waypoints.go(self._owner.ms, place)
        else:
            self._waypoints.follow(self._owner.ms, place)
        self.target, self._goes, self._tells = None, True, True

    def report(self) -> WayReport | None:
        """Return the way to the place."""
        if self._goes:
            return self._way()
        return None if self.target is not None else self._loiter_report()

    def set_speed(self, speed: float) -> bool:
        """Take a new speed limit [m/s] on the way to a place."""
        return self._goes and self._waypoints.set_speed(speed)

    def _run_to_place(self) -> None:
        if not self._waypoints.reached:
            self._helm.navigate()
            return
        if self._tells:
            self._tells = False
            self._owner.reached_items.append(0)
        self._stay()

    def _follow(self, target: GuidedTarget) -> None:
        if target.heading is None:
            self._helm.steer_rate(target.rate)
        else:
            self._helm.steer_heading(target.heading)
        self._helm.drive_speed(target.speed)

    def _stay(self) -> None:
        self.target, self._goes = None, False
        self._helm.loiter.start()
