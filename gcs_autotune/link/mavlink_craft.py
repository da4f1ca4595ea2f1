"""The craft that manoeuvres fly, over MAVLink."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass

from gcs_autotune.clock import Clock, Deadline
from gcs_autotune.craft import Actuate, Command, DepthTarget, HeadingTarget, Observation, TurnRateTarget
from gcs_autotune.errors import (
    ArmingRefused,
    GuardTripped,
    NotAsFound,
    TelemetryFault,
)
from gcs_autotune.firmware import Firmware, ServoMap
from gcs_autotune.link.commands import Commands
from gcs_autotune.link.overrides import OverrideMap
from gcs_autotune.link.parameters import Parameters
from gcs_autotune.link.rate_stick import RateStick
from gcs_autotune.link.rates import Rates
from gcs_autotune.link.recorder import Recorder
from gcs_autotune.link.session import Session
from gcs_autotune.link.targets import ATTITUDE_TARGETS, depth_target, turn_rate_target
from gcs_autotune.link.telemetry import Telemetry
from gcs_autotune.trial import Mark, Trial

__all__ = ["MavlinkCraft", "Wiring"]

_REFRESH = 0.1
"""Seconds of link time after which the active command is repeated."""
_STALE = 0.15
"""Chosen: the same in vehicle time; above one control period, so that a command per tick is not doubled."""
_TICK_TIMEOUT = 3.0
_NEUTRAL = 0.03
"""Chosen: fraction of full output that still counts as neutral; a trim offset of a few microseconds."""
_NEUTRAL_TIMEOUT = 5.0
_RELEASES = 5
_WARM_UP = 1.0
"""Seconds of neutral overrides before arming: without an RC receiver Rover arms only when they flow."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """How this vehicle's inputs and outputs are connected, as read from its parameters.

    ``full_speed`` [m/s] is what full thrust asks for in guided mode (WP_SPEED), 0 when there is none. ``rate_stick``
    says what turn rate the yaw stick asks for in the stabilised modes, None where targets do that (boats).
    """

    overrides: OverrideMap
    servos: ServoMap
    full_speed: float = 0.0
    rate_stick: RateStick | None = None


class MavlinkCraft:
    """Implements :class:`gcs_autotune.craft.Craft` on a session. Made by :func:`open_craft`.

    Attributes
    ----------
    session, parameters, commands, rates : the parts it is made of.
    arm_patience : seconds of link time that :meth:`arm` keeps trying while the pre-arm checks settle.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        wiring: Wiring,
        *,
        parameters: Parameters,
        commands: Commands,
        rates: Rates,
        arm_patience: float = 10.0,
    ) -> None:
        assert session.vehicle is not None
        self.session = session
        self.parameters = parameters
        self.commands = commands
        self.rates = rates
        self.arm_patience = arm_patience
        self._firmware = firmware
        self._wiring = wiring
        self._ids = (session.vehicle.system, session.vehicle.component)
        self._recorder = Recorder()
        self.telemetry = Telemetry(session, wiring.servos, self._recorder)
        self._active: Command | None = None
        self._sent_t = -math.inf
        self._expected_mode: int | None = None
        self._expected_armed: bool | None = None
        self._duty = session.every(_REFRESH, self._refresh)
        session.listen("ATTITUDE", lambda _: self._refresh_in_vehicle_time())

    @property
    def firmware(self) -> Firmware:
        """What kind of autopilot it is."""
        return self._firmware

    @property
    def clock(self) -> Clock:
        """The link's clock."""
        return self.session.clock

    @property
    def mode(self) -> str:
        """The present flight mode, by name."""
        return self.commands.mode

    @property
    def armed(self) -> bool:
        """Whether the vehicle is armed."""
        return self.session.armed

    @property
    def skid(self) -> bool:
        """Whether it steers by the difference of two thrusters."""
        return self._wiring.servos.skid

    # --- watching -----------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """Wait for the next ATTITUDE and return everything known at it.

        Raises
        ------
        LinkLost, OperatorStopped
            From the session.
        TelemetryFault
            NaN, frozen or jumping telemetry; or no attitude although the vehicle is heard.
        GuardTripped
            While a command is in force: mode, arming or a borrowed parameter was changed, not by us.
        """
        seen, deadline = self.telemetry.ticks, Deadline.after(self.clock, _TICK_TIMEOUT)
        while self.telemetry.ticks == seen:
            self.telemetry.watchdog.check()
            if deadline.expired:
                raise TelemetryFault(
                    f"no usable ATTITUDE for {_TICK_TIMEOUT:g} s although the vehicle is heard; is another "
                    "ground station changing the stream rates?"
                )
            self.session.pump()
        self.telemetry.watchdog.check()
        self._check_hands()
        return self._observation()

    def _observation(self) -> Observation:
        telemetry, value = self.telemetry, self.telemetry.value
        return Observation(
            t=telemetry.t,
            psi=value("psi"),
            r=value("r"),
            phi=value("phi"),
            theta=value("theta"),
            x=value("x"),
            y=value("y"),
            z=value("z"),
            u=value("u"),
            v=value("v"),
            w=value("w"),
            speed=value("U"),
            output=telemetry.outputs,
            output_t=telemetry.output_t,
            armed=self.armed,
            mode=self.mode,
            battery_voltage=value("battery"),
            battery_remaining=value("battery_remaining"),
            age=self.session.silence,
        )

    def _check_hands(self) -> None:
        """Look for other hands on the vehicle, while we command it."""
        if self._active is None:
            return
        if self.parameters.intrusions:
            name, old, new = self.parameters.intrusions[0]
            raise GuardTripped(
                f"another ground station wrote {name} = {new:g} (it was {old:g}); disconnect it and start again",
                guard="parameters",
                value=new,
                limit=old,
            )
        if self._expected_mode is not None and self.session.custom_mode != self._expected_mode:
            expected = self._firmware.mode_name(self._expected_mode)
            raise GuardTripped(
                f"the vehicle went from {expected} to {self.mode}, not by us{self._last_words()}", guard="mode"
            )
        if self._expected_armed and not self.armed:
            raise GuardTripped(f"the vehicle was disarmed, not by us{self._last_words()}", guard="armed")

    def _last_words(self) -> str:
        texts = self.session.texts.recent(self.clock.now() - 5.0)
        return f" (it says: {'; '.join(texts)})" if texts else ""

    # --- commanding ---------------------------------------------------------------------------------------

    def send(self, command: Command) -> None:
        """Put *command* on the wire and keep it in force until another one or :meth:`neutral`."""
        if self._active is None:
            self._expected_mode = self.session.custom_mode
            self._expected_armed = self.session.armed
        self._active = command
        self._transmit(command)

    def _refresh(self) -> None:
        if self._active is not None:
            self._transmit(self._active)

    def _refresh_in_vehicle_time(self) -> None:
        """A simulator that runs ahead of the wall clock lets overrides expire by its own time."""
        if self.telemetry.t - self._sent_t > _STALE:
            self._refresh()

    def _transmit(self, command: Command) -> None:
        """Send the command; targets go with neutral overrides, which tell the failsafes that we are there."""
        self._duty.postpone()
        self._sent_t = self.telemetry.t
        manual = command if isinstance(command, Actuate) else Actuate()
        if isinstance(command, TurnRateTarget) and self._wiring.rate_stick is not None:
            manual = Actuate(N=self._wiring.rate_stick.deflection(command.r, self.telemetry.value("pilot_gain")))
        self.session.send(self._wiring.overrides.message(manual, *self._ids))
        if isinstance(command, HeadingTarget):
            encode = ATTITUDE_TARGETS[self._firmware.kind]
            self.session.send(encode(self._ids, command, self._wiring.full_speed))
        elif isinstance(command, TurnRateTarget) and self._firmware.kind == "boat":
            self.session.send(turn_rate_target(self._ids, command, self._wiring.full_speed))
        elif isinstance(command, DepthTarget):
            self.session.send(depth_target(self._ids, command))

    def set_mode(self, mode: str) -> None:
        """Change the flight mode and wait until the heartbeat confirms it."""
        self._expected_mode = None
        self.commands.set_mode(mode)
        self._expected_mode = self.session.custom_mode

    def arm(self) -> None:
        """Arm, with neutral overrides flowing, and wait until the heartbeat confirms it.

        Raises
        ------
        ArmingRefused
            Still refused after ``arm_patience`` seconds, with the vehicle's reasons.
        """
        self.send(Actuate())
        self.session.pause(_WARM_UP)
        deadline = Deadline.after(self.clock, self.arm_patience)
        while True:
            try:
                self.commands.arm()
                break
            except ArmingRefused:
                if deadline.expired:
                    self._active = None
                    self._release()
                    raise
                self.session.pause(_WARM_UP)
        self._expected_armed = True

    def disarm(self) -> None:
        """Disarm and wait until the heartbeat confirms it."""
        self._expected_armed = None
        self.commands.disarm()

    def neutral(self) -> None:
        """Bring every actuator to neutral, check that by the measured outputs, and release the overrides.

        When the autopilot itself is steering, the rest mode ends that first. The operator has to wait.

        Raises
        ------
        NotAsFound
            The outputs did not become neutral, or cannot be seen to be.
        LinkError
            The vehicle cannot be heard; the neutral command was sent all the same.
        """
        with self.session.shielded():
            self._expected_mode = self._expected_armed = None
            self._active = Actuate()
            try:
                for _ in range(_RELEASES):
                    self._transmit(Actuate())
                if self.mode != self._firmware.manual_mode and self.mode != self._firmware.rest_mode:
                    self.commands.set_mode(self._firmware.rest_mode)
                self._await_neutral()
            finally:
                self._active = None
                self._release()

    def _await_neutral(self) -> None:
        begun = self.telemetry.output_ticks
        settled = self.session.wait_for(lambda: self._is_neutral(begun), _NEUTRAL_TIMEOUT)
        if settled:
            return
        outputs = self.telemetry.outputs
        stuck = {n: f"{f:+.2f} of full output" for n, f in outputs.items() if not abs(f) <= _NEUTRAL}
        if not stuck:
            stuck = {"outputs": "not heard any more"}
        raise NotAsFound(
            f"the actuators are not neutral after {_NEUTRAL_TIMEOUT:g} s: "
            + ", ".join(f"{name} {what}" for name, what in stuck.items())
            + "; take over by hand",
            differences=stuck,
        )

    def _is_neutral(self, begun: int) -> bool | None:
        fresh = self.telemetry.output_ticks > begun + 1
        still = all(abs(force) <= _NEUTRAL for force in self.telemetry.outputs.values())
        return True if fresh and still else None

    def _release(self) -> None:
        for _ in range(_RELEASES):
            self.session.send(self._wiring.overrides.release(*self._ids))

    def shielded(self) -> AbstractContextManager[None]:
        """While inside, the operator's stop is remembered but not raised."""
        return self.session.shielded()

    # --- recording ----------------------------------------------------------------------------------------

    def start_recording(self, name: str) -> None:
        """Begin a new trial; everything heard from now on belongs to it."""
        self._recorder.start(name)

    def mark(self, mark: Mark) -> None:
        """Attach an event to the running trial."""
        self._recorder.mark(mark)

    def stop_recording(self, ending: str, reason: str = "") -> Trial:
        """End the running trial and return it."""
        vehicle = self.session.vehicle
        assert vehicle is not None
        meta = {
            "vehicle": vehicle.to_dict(),
            "link": self.session.transport.description,
            "firmware": self._firmware.name,
            "outputs_dated": "midway",
        }
        return self._recorder.stop(ending, reason, meta)
