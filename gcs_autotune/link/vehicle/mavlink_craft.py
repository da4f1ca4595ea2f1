"""A craft that manoeuvres can fly, controlled over MAVLink."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from typing import Any

from gcs_autotune.clock import Clock
from gcs_autotune.craft import Actuate, Command, Intervention, Observation, SteeredBy
from gcs_autotune.errors import AutotuneError, LinkError, LinkLost, ModeRefused, NoReply, NotAsFound
from gcs_autotune.firmware import Firmware, ServoMap, SetFailsafe, read_servo_map
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.vehicle.actuation_check import await_neutral, check_outputs_follow, check_overrides_taken
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.link.vehicle.congestion import check_uplink
from gcs_autotune.link.vehicle.interference_monitor import Evidence, InterferenceMonitor, RateKeeper
from gcs_autotune.link.vehicle.latency import Latency, LinkTimes, least_period
from gcs_autotune.link.vehicle.other_stations import OtherStations
from gcs_autotune.link.vehicle.rates import Rates
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.setpoint_streamer import SetpointStreamer
from gcs_autotune.link.vehicle.telemetry import Recorder, Telemetry, await_tick, observation
from gcs_autotune.link.vehicle.vehicle_config import VehicleConfig
from gcs_autotune.mavlink import message_number
from gcs_autotune.registry import lookup
from gcs_autotune.trial import Mark, Trial

__all__ = ["MavlinkCraft", "VehicleConfig", "read_failsafes"]

_FRESH = 3.5
"""Time [s] to wait for a HEARTBEAT before a mode is commanded: three heartbeats. Project choice."""
_GLANCE = 0.5
"""Time [s] to wait for the state before the rest mode is commanded, which must not be delayed. Project choice.
Project choice."""
_PATIENCE = 30.0
"""Time [s] to wait for a silent vehicle when making it neutral. Project choice."""
_WARM_UP = 1.0
"""Time [s] between two attempts to arm.

Neutral overrides are sent before the first attempt, because a Rover without an RC receiver does not arm without them.
"""


class MavlinkCraft:
    """Implements :class:`gcs_autotune.craft.Craft` on a session. Made by :func:`open_craft`.

    Attributes
    ----------
    session, parameters, commands, rates, latency, other_stations : the objects that it consists of.
    arm_patience : seconds of link time for which :meth:`arm` retries while the pre-arm checks settle.
    on_order : called with ``ordering``, ``ordered`` or ``yielded`` and the command, for the journal. It must not raise
        an exception or block the link.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        config: VehicleConfig,
        *,
        parameters: Parameters,
        commands: Commands,
        rates: Rates,
        arm_patience: float = 10.0,
    ) -> None:
        self.session = session
        self.parameters = parameters
        self.commands = commands
        self.rates = rates
        self.arm_patience = arm_patience
        self.on_order: Callable[[str, Mapping[str, Any]], None] = lambda event, what: None
        self._firmware = firmware
        self._config = config
        self._recorder = Recorder()
        self.telemetry = Telemetry(
            session, config.servos, self._recorder, loop_period=config.loop_period, rate_lag=config.rate_lag
        )
        self.latency = Latency(session)
        self.other_stations = OtherStations(session)
        self._rc_monitor = RcMonitor(session)
        self._streamer = SetpointStreamer(session, firmware, config, self.telemetry, self.latency, self._rc_monitor)
        self._interference = InterferenceMonitor(
            session,
            firmware,
            parameters,
            commands,
            Evidence(self.other_stations, self._rc_monitor, self._streamer.send_rate, self.telemetry.watchdog),
            let_go=self._rest_sticks,
        )
        self._interference.lateness = lambda: self.latency.lateness
        self._interference.on_yield = lambda what: self.on_order("yielded", what)
        self._is_taken_over = False
        self._is_only_watched = False
        self._mode_is_changing = False

    def keep_rates(self) -> None:
        """Keep the fitted message rates: request them again after changes by other stations, and reduce them on a full
        link.
        """
        RateKeeper(self.session, self.rates, self.other_stations).start()
        if math.isfinite(self.rates.capacity):
            self._streamer.spare_the_link()

    def only_watch(self) -> None:
        """Send as few overrides as keep the sticks neutral, because no control loop is closed over this link."""
        self._is_only_watched = True
        self._streamer.spare_the_link()

    def learn_failsafes(self) -> None:
        """Read from the parameters which failsafes act without a ground station, after what time, and how."""
        self._interference.failsafes = read_failsafes(self.parameters, self._firmware)

    def learn_outputs(self) -> None:
        """Read the relation between servo outputs and forces again, after a change of SERVOn_MIN, TRIM or MAX."""
        self._config = replace(self._config, servos=read_servo_map(self.parameters, self._firmware))
        self.telemetry.servos = self._config.servos

    @property
    def firmware(self) -> Firmware:
        """The firmware of the vehicle's autopilot."""
        return self._firmware

    @property
    def servos(self) -> ServoMap:
        """Relation between the servo outputs and the forces of the vehicle."""
        return self._config.servos

    @property
    def forces(self) -> tuple[str, ...]:
        """Forces that the craft can be commanded to produce and whose outputs it reports, as ``("X", "Z", "N")``.

        The firmware has a channel for each, and an output of the frame drives it.
        """
        return tuple(force for force in self.firmware.channels if self.servos.driving(force))

    @property
    def clock(self) -> Clock:
        """The clock of the link, in real or simulated time."""
        return self.session.clock

    @property
    def mode(self) -> str:
        """Name of the present flight mode."""
        return self.commands.mode

    @property
    def armed(self) -> bool:
        """Whether the vehicle is armed."""
        return self.session.armed

    def await_heartbeat(self) -> None:
        """Wait for the next HEARTBEAT, so that :attr:`armed` and :attr:`mode` are current; ``LinkLost`` if none
        arrives."""
        self.session.await_heartbeat()

    def take_over(self) -> None:
        """Monitor changes of mode or armed state not commanded by us, until :meth:`give_back`."""
        self._is_taken_over = True
        self._interference.take_over()

    def give_back(self) -> None:
        """Stop monitoring changes of mode and armed state."""
        self._is_taken_over = False
        self._interference.give_back()

    def intervention(self) -> Intervention | None:
        """Request mode and armed state.

        Return the first change since :meth:`take_over` that was not commanded by us.
        """
        if self._interference.is_ours and self._interference.found is None:
            with suppress(LinkLost):
                self.session.ask_state(_FRESH)
        return self._interference.look()

    def check_restart(self) -> None:
        """Request the vehicle's time since boot for a second, so that the watchdog can detect a restart."""
        watchdog = self.telemetry.watchdog
        stamps = watchdog.stamps
        self.session.request_message(message_number("SYSTEM_TIME"))
        self.session.wait_for(lambda: True if watchdog.has_restarted or watchdog.stamps > stamps else None, 1.0)

    def yield_to(self, what: str) -> None:
        """Leave the craft to an operator who has taken it by its sticks. *what* states it in words."""
        self._interference.yield_to(what)

    def accept_intervention(self) -> None:
        """Accept the present mode and armed state after the operator has agreed."""
        self._interference.accept()

    @property
    def steered_by(self) -> SteeredBy:
        """Name of the type of steering, used for assumptions about similar craft."""
        if not self.firmware.needs_way:
            return "rov"
        return "thrusters" if self.skid else "rudder"

    @property
    def skid(self) -> bool:
        """Whether the craft steers by the difference of two thrusters."""
        return self._config.servos.skid

    @property
    def has_receiver(self) -> bool:
        """Whether an RC receiver delivers channels."""
        return bool(self._rc_monitor.has_receiver)

    @property
    def stick_channels(self) -> tuple[int, ...]:
        """RC channels of the sticks that drive the craft in manual mode."""
        return tuple(sorted({number for number, _ in self._config.overrides.channels.values()}))

    # --- watching -----------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """Wait for the next ATTITUDE and return all values known at that time.

        Raises
        ------
        LinkLost, OperatorStopped
            Raised by the session.
        TelemetryFault
            NaN, frozen or jumping telemetry; or no attitude although other messages arrive.
        GuardTripped
            Mode or armed state was changed, but not by us. While a command is in force, also for the sticks or a
                parameter that we changed.
        """
        await_tick(self.session, self.telemetry)
        if self._streamer.active is not None:
            self._interference.check()
        else:
            self._interference.check_state()
        return observation(self.session, self.telemetry, self.mode)

    @property
    def link_times(self) -> LinkTimes:
        """Delays of the link measured so far, with the rate and longest gap of the overrides."""
        return self.latency.times(self._streamer.send_rate.rate, self._streamer.send_rate.longest)

    def longest_pause(self, since: float) -> float:
        """Return the longest pause between commands since link time *since* [s], in seconds of the vehicle's time.

        It is 0 in simulated time, which does not advance while this computer pauses.
        """
        if self.session.transport.is_simulated:
            return 0.0
        rate = self._streamer.send_rate
        return rate.pause_since(since) * max(rate.pace, 1.0)

    @property
    def lateness(self) -> float:
        """Present delay [s of the vehicle's time] from a command to its report: a round trip of the link."""
        return self.latency.lateness * max(self._streamer.send_rate.pace, 1.0)

    @property
    def least_period(self) -> float:
        """Shortest oscillation period [s] that can be flown over this link and still be identified; 0 if unknown."""
        return least_period(self.latency.loop, self.rates.measured.get("ATTITUDE", 0.0))

    # --- commanding ---------------------------------------------------------------------------------------

    def send(self, command: Command) -> None:
        """Send *command* and keep it in force until another one, :meth:`neutral` or :meth:`release`.

        Raises
        ------
        GuardTripped, TelemetryFault
            Mode or armed state was changed, but not by us, according to the last heartbeat.
        """
        self._interference.take_over()
        self._interference.check_state()
        self._streamer.command(command)

    def set_mode(self, mode: str) -> None:
        """Change the flight mode and wait until the heartbeat confirms it.

        Mode and armed state are requested first, so that a command of another station since the last heartbeat is
        respected.

        Raises
        ------
        GuardTripped, TelemetryFault
            Mode or armed state was changed, but not by us. Nothing was commanded.
        LinkLost
            No heartbeat arrived.
        """
        self._check_fresh()
        try:
            self._order_mode(mode)
        except (ModeRefused, NoReply):
            self._interference.check_state()  # another station ordered one just now
            raise

    def _order_mode(self, mode: str) -> None:
        number, before = lookup(self._firmware.modes, mode, f"{self._firmware.name} mode"), self._interference.modes
        self._interference.order_mode(number)
        self._note_order(mode=mode)
        try:
            self.commands.set_mode(mode)
        except LinkError:
            if self.commands.accepted_mode != number:  # when it shows later, that it was ours is not certain
                self._interference.doubt_mode(number, before)
            raise
        except ModeRefused:
            if self.commands.accepted_mode == number:  # it was in force, and another one has been ordered since
                self._interference.confirm_mode(number)
            raise
        self._interference.confirm_mode(number)
        self.on_order("ordered", {"mode": mode})

    def _note_order(self, **what: Any) -> None:
        boot = self.telemetry.boot_time
        self.on_order("ordering", what if math.isnan(boot) else {**what, "boot": boot})

    def _check_fresh(self) -> None:
        """Verify that mode and armed state are those that we set last."""
        if not self._interference.is_ours:
            return
        if not self.session.ask_state(_FRESH):
            raise LinkLost(
                f"{self.session.vehicle} sent no HEARTBEAT for {_FRESH:g} s, so its mode is unknown. Check the link"
            )
        self._interference.check_state()

    def arm(self) -> None:
        """Arm with neutral overrides, and verify that the outputs follow.

        Before arming, RC_CHANNELS must show our overrides, and the link must have the capacity for all later messages
        (except after :meth:`only_watch`).
        After arming in manual mode, the steering is moved by 5 % each way without thrust, and SERVO_OUTPUT_RAW must
        follow. This also measures the delay from command to servo.

        Raises
        ------
        ArmingRefused
            Still refused after ``arm_patience`` seconds, with the vehicle's reasons.
        PreconditionFailed
            The vehicle ignores our overrides, or its outputs do not follow. The message states the likely cause.
        GuardTripped
            Another station changed mode or armed state during arming.
        TelemetryFault
            The link does not have the capacity for all messages. The vehicle was not armed.
        """
        try:
            self.send(Actuate())
            check_overrides_taken(self.session, self._streamer, self._rc_monitor, self.parameters, self._firmware)
            if not self._is_only_watched:
                check_uplink(self.session, self._streamer, self.latency)
            self._arm()
            self.set_mode(self._firmware.manual_mode)
            check_outputs_follow(self._streamer, self.telemetry, self.observe, self.mode, skid=self.skid)
        except LinkLost:
            self._let_go()
            self._explain_silence()
            raise
        except AutotuneError:
            self._let_go()
            raise

    def _explain_silence(self) -> None:
        """Wait for a silent vehicle; raise ``TelemetryFault`` if it has restarted."""
        with self.session.operator.shielded():
            if not self.session.outlast(_PATIENCE):
                return
            with suppress(LinkLost):
                self.check_restart()
        if self.telemetry.watchdog.has_restarted:
            self.telemetry.watchdog.check()

    def _arm(self) -> None:
        """Arm, unless another station has taken over the vehicle between two attempts.

        Once the command is sent, an armed vehicle counts as armed by us, even if the answer is lost.
        """

        def check() -> None:
            self._check_fresh()
            self.session.patience = 0.0  # from here on a silence ends what is flown, neutral first
            self._note_order(armed=True)
            self._interference.armed = None

        self.commands.arm_patiently(self.arm_patience, _WARM_UP, check)
        self._interference.armed = True

    def disarm(self) -> None:
        """Disarm, wait until the heartbeat confirms it, and release the sticks."""
        self._interference.armed = None
        self.commands.disarm()
        self._interference.armed = False if self._interference.is_ours else None
        self.on_order("ordered", {"armed": False})
        self.release()

    def neutral(self) -> None:
        """Bring every actuator to neutral and verify this by the measured outputs.

        If the autopilot itself is steering, the rest mode is commanded first. While the vehicle is armed, neutral
        overrides continue until :meth:`disarm` or :meth:`release`. Without them a vehicle without an RC receiver would
        trigger its radio failsafe a second after the last one.

        The operator cannot interrupt. If the vehicle has fallen silent, wait for it once. If another station has
        commanded a mode, the sticks are released in neutral.

        Raises
        ------
        NotAsFound
            The outputs did not become neutral, or are not reported. The overrides are released.
        LinkError
            The vehicle does not answer. The neutral command was sent nevertheless.
        """
        with self.session.operator.shielded():
            try:
                self._make_neutral_in_time()
            except BaseException:
                self._let_go()
                raise
            if not self.armed:
                self.release()

    def _make_neutral_in_time(self) -> None:
        """Make the vehicle neutral. Wait once if it has fallen silent."""
        try:
            self._make_neutral()
        except LinkLost:
            if not self.session.outlast(_PATIENCE):
                raise
            self._make_neutral()

    def _make_neutral(self) -> None:
        if self._is_taken():
            return
        self._streamer.rest()
        at_rest = {self._firmware.modes[m] for m in (self._firmware.manual_mode, self._firmware.rest_mode)}
        if not {self.session.custom_mode, *self._interference.modes} <= at_rest:  # a mode order may be on its way
            self.session.ask_state(_GLANCE)
            if self._is_taken():
                return
            try:
                self._order_mode(self._firmware.rest_mode)
            except (ModeRefused, NoReply):
                if self._is_taken():
                    return
                raise
        try:
            await_neutral(self.session, self.telemetry)
        except NotAsFound:
            if not self._is_taken():  # in a mode that another station has just ordered the autopilot may steer
                raise

    def _is_taken(self) -> bool:
        """Release the neutral sticks if another station has commanded a mode. Return whether one has."""
        change = self._interference.look()
        if change is None or not change.mode_stands:
            return False
        self._rest_sticks()
        self._let_go()
        return True

    def _rest_sticks(self) -> None:
        if self._streamer.active is not None:
            self._streamer.rest()

    def release(self) -> None:
        """Return the sticks to the RC receiver and verify this by RC_CHANNELS.

        Without a receiver RC_CHANNELS shows nothing: the vehicle keeps the last value, which was neutral. The operator
        cannot interrupt.

        Raises
        ------
        NotAsFound
            RC_CHANNELS still shows our overrides; they end by themselves after RC_OVERRIDE_TIME.
        """
        if self._streamer.active is None:
            return
        with self.session.operator.shielded():
            self._end_of_hold()
            if not self._streamer.let_go_visibly():
                raise NotAsFound(
                    "the overrides were released, but the vehicle still shows them. They expire after "
                    "RC_OVERRIDE_TIME (neutral until then). Check whether another station sends the same overrides",
                    differences={"overrides": "still in force"},
                )

    def _let_go(self) -> None:
        self._end_of_hold()
        self._streamer.let_go()

    def _end_of_hold(self) -> None:
        """Stop holding the sticks. Monitoring continues if it was started separately."""
        if not self._is_taken_over:
            self._interference.give_back()

    def shielded(self) -> AbstractContextManager[None]:
        """Return a context in which the operator's stop is stored but not raised."""
        return self.session.operator.shielded()

    # --- recording ----------------------------------------------------------------------------------------

    def start_recording(self, name: str) -> None:
        """Begin a new trial. All telemetry received from now on belongs to it."""
        self._recorder.start(name)

    def mark(self, mark: Mark) -> None:
        """Add an event at the present time to the running trial."""
        self._recorder.mark(mark)

    def stop_recording(self, ending: str, reason: str = "") -> Trial:
        """End the running trial and return it."""
        return self._recorder.stop(ending, reason, self._described())

    def recorded_so_far(self, settings: Mapping[str, Any]) -> Trial:
        """Return the trial so far, with the *settings* of the manoeuvre in its ``meta``."""
        return self._recorder.so_far("", "", {**self._described(), **settings})

    def _described(self) -> dict[str, Any]:
        """Return the data on vehicle and link that are stored in every trial."""
        vehicle = self.session.vehicle
        assert vehicle is not None
        return {
            "vehicle": vehicle.to_dict(),
            "link": self.session.transport.description,
            "firmware": self._firmware.name,
            "outputs_dated": "midway",
            "loop_period": self._config.loop_period,
            "rate_lag": self._config.rate_lag,
            "link_times": self.link_times.to_dict(),
        }


def read_failsafes(parameters: Parameters, firmware: Firmware) -> tuple[SetFailsafe, ...]:
    """Return the failsafes that act on the loss of a ground station, as set by *parameters*."""
    values = parameters.read_existing(dict.fromkeys(name for f in firmware.failsafes for name in f.parameters))
    settings = (failsafe.set_by(values) for failsafe in firmware.failsafes)
    return tuple(failsafe for failsafe in settings if failsafe is not None)
