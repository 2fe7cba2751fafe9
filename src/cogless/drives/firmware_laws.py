"""Laws of drives' firmware with their cogging tables, written from their sources: one class for each drive.

A study takes one of these classes as its law by law = "python", object = "firmware_laws.py:Moteus". Gains
have the firmware's own units, so they are as in its configuration. Angles are the rotor's, rad; currents are
peak A. `share`: factor on the table; 0: no table, -1: the opposite sign.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from ctypes import c_float, c_int8
from typing import Protocol

MOTEUS_ENTRIES = 1024
ODRIVE_CELLS = 3600
ODRIVE_DECAY = 0.99  # factor on the integrator, in each step whose torque is limited


class Drive(Protocol):
    """What these laws need of the drive that a study describes."""

    torque_constant: float  # N m/A


class Inputs(Protocol):
    """What these laws need of the inputs of a step."""

    ts: float  # s
    theta_m: float  # rad, within a turn, measured
    theta_ref: float  # rad, within a turn
    omega_ref: float  # rad/s
    i_limit: float  # A


class MoteusTable:
    """`motor.cogging_dq_comp` times `cogging_dq_scale`: entry i at i / 1024 turn, straight lines between."""

    def __init__(self, scale: float, entries: Sequence[int]) -> None:
        if len(entries) != MOTEUS_ENTRIES:
            raise ValueError(f"{len(entries)} entries: expected {MOTEUS_ENTRIES}")
        self.scale = c_float(scale).value
        self.entries = [c_int8(round(entry)).value for entry in entries]  # an entry of 128 becomes -128

    def current(self, index: float) -> float:
        """The current, A, at an angle of the commutation source, rad, in any turn."""
        place = (index / math.tau % 1.0) * MOTEUS_ENTRIES
        first = int(place)
        share = place - first
        low, high = self.entries[first % MOTEUS_ENTRIES], self.entries[(first + 1) % MOTEUS_ENTRIES]
        return self.scale * ((1.0 - share) * low + share * high)


class HeaderTable:
    """The table of the header that cogless writes: entry i is at i / count turn, straight lines between."""

    def __init__(self, entries: Sequence[float]) -> None:
        self.entries = [c_float(entry).value for entry in entries]

    def current(self, angle: float) -> float:
        """The current, A, at `motor.shaft_angle`, rad, in any turn."""
        place = angle / math.tau * len(self.entries)
        first = math.floor(place)
        low = self.entries[first % len(self.entries)]
        return low + (place - first) * (self.entries[(first + 1) % len(self.entries)] - low)


class OdriveMap:
    """`anticogging.cogging_map` of firmware 0.5, N m: cell i holds from i / 3600 turn to the next.

    The index is cut toward zero, so that at negative angles each cell acts one cell later in the turn.
    """

    def __init__(self, cells: Sequence[float]) -> None:
        if len(cells) != ODRIVE_CELLS:
            raise ValueError(f"{len(cells)} cells: expected {ODRIVE_CELLS}")
        self.cells = [c_float(cell).value for cell in cells]

    def torque(self, angle: float) -> float:
        """The torque, N m, at the angle of `pos_estimate`, rad, in any turn."""
        return self.cells[int(angle / math.tau * ODRIVE_CELLS) % ODRIVE_CELLS]


class Tracker:
    """An encoder's angle and speed through a critically damped filter of the second order.

    moteus and ODrive have this filter. `bandwidth`: rad/s. The angle, rad, goes on from turn to turn.
    """

    def __init__(self, bandwidth: float) -> None:
        self.bandwidth = bandwidth
        self.angle = math.nan
        self.speed = 0.0

    def step(self, theta: float, ts: float) -> None:
        """A sample of the encoder, rad within a turn, `ts` s after the one before."""
        if math.isnan(self.angle):
            self.angle = theta
        self.angle += ts * self.speed
        error = math.remainder(theta - self.angle, math.tau)
        self.angle += 2.0 * self.bandwidth * ts * error
        self.speed += self.bandwidth**2 * ts * error


class Setpoint:
    """The set angle, rad: it begins at the rotor's angle and goes on from turn to turn."""

    def __init__(self) -> None:
        self.theta_ref = self.angle = math.nan

    def step(self, theta_ref: float, angle: float) -> float:
        """The set angle, rad. `theta_ref`: within a turn; `angle`: the rotor's."""
        if math.isnan(self.angle):
            self.theta_ref, self.angle = theta_ref, angle
        self.angle += math.remainder(theta_ref - self.theta_ref, math.tau)
        self.theta_ref = theta_ref
        return self.angle


class Moteus:
    """Position mode (fw/pid.h): a PID whose torque is limited; the table is added after the limit.

    `kp`, `ki`, `kd`: of `servo.pid_position`, N m/turn, N m/(turn s) and N m s/turn of the output. `ratio`:
    turns of the output / those of the rotor. `direction`: 1; -1: the index falls as the angle grows.
    """

    def __init__(
        self,
        drive: Drive,
        kp: float,
        kd: float,
        ki: float = 0.0,
        ilimit: float = 0.0,
        torque_limit: float = math.inf,
        filter_hz: float = 400.0,
        ratio: float = 1.0,
        direction: int = 1,
        scale: float = 0.0,
        entries: Sequence[int] = (0,) * MOTEUS_ENTRIES,
        share: float = 1.0,
    ) -> None:
        self.kp, self.ki, self.kd, self.ilimit = kp, ki, kd, ilimit
        self.torque_limit, self.ratio, self.direction = torque_limit, ratio, direction
        self.torque_constant = drive.torque_constant / ratio  # N m at the output for 1 A
        self.table = MoteusTable(share * scale, entries)
        self.tracker, self.setpoint, self.integral = Tracker(math.tau * filter_hz), Setpoint(), 0.0

    def step(self, inputs: Inputs) -> float:
        """i_q_ref, A."""
        self.tracker.step(inputs.theta_m, inputs.ts)
        angle = self.tracker.angle
        turns = self.ratio / math.tau
        error = turns * (angle - self.setpoint.step(inputs.theta_ref, angle))
        error_rate = turns * (self.tracker.speed - inputs.omega_ref)
        self.integral += error * self.ki * inputs.ts
        self.integral = max(-self.ilimit, min(self.ilimit, self.integral))
        torque = -(self.kp * error + self.kd * error_rate + self.integral)
        torque = max(-self.torque_limit, min(self.torque_limit, torque))
        return torque / self.torque_constant + self.table.current(self.direction * angle)


class Odrive:
    """Firmware 0.5 (Firmware/MotorControl/controller.cpp): P of the position over PI of the speed.

    `pos_gain`: 1/s; `vel_gain`: N m s/turn; `vel_integrator_gain`: N m/turn; `bandwidth`: of the encoder,
    rad/s; `cells`: of the map, N m. The map is added before the limit.
    """

    def __init__(
        self,
        drive: Drive,
        pos_gain: float,
        vel_gain: float,
        vel_integrator_gain: float,
        bandwidth: float = 1000.0,
        vel_limit: float = math.inf,
        cells: Sequence[float] = (0.0,) * ODRIVE_CELLS,
        share: float = 1.0,
    ) -> None:
        self.pos_gain, self.vel_gain, self.vel_integrator_gain = pos_gain, vel_gain, vel_integrator_gain
        self.torque_constant = drive.torque_constant
        self.vel_limit, self.share = vel_limit, share
        self.map, self.tracker, self.setpoint = OdriveMap(cells), Tracker(bandwidth), Setpoint()
        self.integral = 0.0

    def step(self, inputs: Inputs) -> float:
        """i_q_ref, A."""
        self.tracker.step(inputs.theta_m, inputs.ts)
        angle = self.tracker.angle
        position_error = (self.setpoint.step(inputs.theta_ref, angle) - angle) / math.tau
        speed = inputs.omega_ref / math.tau + self.pos_gain * position_error
        error = max(-self.vel_limit, min(self.vel_limit, speed)) - self.tracker.speed / math.tau
        torque = self.share * self.map.torque(angle) + self.vel_gain * error + self.integral
        most = inputs.i_limit * self.torque_constant
        if abs(torque) > most:
            torque = math.copysign(most, torque)
            self.integral *= ODRIVE_DECAY
        else:
            self.integral += self.vel_integrator_gain * inputs.ts * error
        return torque / self.torque_constant


class SimpleFoc:
    """Speed control with torque by a current (src/common/pid.cpp); the table is added after the limit.

    `P`, `I`, `D`: of `motor.PID_velocity`, A s/rad, A/rad, A s^2/rad; `output_ramp`: A/s, 0 for none;
    `Tf`: of `motor.LPF_velocity`, s.
    """

    def __init__(
        self,
        P: float,
        I: float,  # noqa: E741, the name of the library
        D: float = 0.0,
        output_ramp: float = 0.0,
        Tf: float = 0.005,
        entries: Sequence[float] = (0.0,),
        share: float = 1.0,
    ) -> None:
        self.P, self.I, self.D, self.output_ramp, self.Tf = P, I, D, output_ramp, Tf
        self.table, self.share = HeaderTable(entries), share
        self.theta, self.speed = math.nan, 0.0
        self.integral = self.error = self.output = 0.0

    def step(self, inputs: Inputs) -> float:
        """i_q_ref, A."""
        ts, limit = inputs.ts, inputs.i_limit
        if math.isnan(self.theta):
            self.theta, self.speed = inputs.theta_m, inputs.omega_ref
        alpha = self.Tf / (self.Tf + ts)
        change = math.remainder(inputs.theta_m - self.theta, math.tau)
        self.speed = alpha * self.speed + (1.0 - alpha) * change / ts
        self.theta = inputs.theta_m
        error = inputs.omega_ref - self.speed
        self.integral += 0.5 * self.I * ts * (error + self.error)
        self.integral = max(-limit, min(limit, self.integral))
        output = self.P * error + self.integral + self.D * (error - self.error) / ts
        output = max(-limit, min(limit, output))
        if self.output_ramp > 0.0:
            most = self.output_ramp * ts
            output = self.output + max(-most, min(most, output - self.output))
        self.error, self.output = error, output
        return output + self.share * self.table.current(inputs.theta_m)
