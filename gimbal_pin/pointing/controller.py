"""The camera's controller for one's own loop: ``torque = controller.step(measurement)``, and its file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.control.laws import ComputedTorque, JointPid, Pid
from gimbal_pin.control.tuning import StoredController, read_robust_term
from gimbal_pin.dynamics.model import read_model_data
from gimbal_pin.dynamics.sensors import Sensors
from gimbal_pin.errors import GimbalPinError, ModelError, UsageError
from gimbal_pin.log.io.files import write_json
from gimbal_pin.log.log import Array, Log
from gimbal_pin.pointing.bench import learn_recipe
from gimbal_pin.pointing.forecast import Spectrum
from gimbal_pin.pointing.level import Level, leveled
from gimbal_pin.pointing.measurement import ACCELEROMETER, GYRO, Measurement, Station
from gimbal_pin.pointing.navigator import Known
from gimbal_pin.pointing.pointer import Held
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.sight import Sight, gyros_between, unable
from gimbal_pin.rig.config import Noise
from gimbal_pin.rig.reading import LARGEST_TEXT, read_bytes
from gimbal_pin.rig.records import bounded_field, convert_value, prefix_place, read_record
from gimbal_pin.rig.rig import Rig

DT = 0.001
"""Sampling interval of a controller that is learned, s."""
WARM_UP = 3
"""Steps that a new controller takes at rest: the first two fill every cache, the third compares a forecast."""


class Controller:
    """Holds a camera still on a platform that moves: one measurement in, one torque out, every `dt` s.

        controller = Controller.learn(rig, log)            # a log of the rig, its base shaken by hand
        controller.save("camera.json")                     # later: Controller.load("camera.json", rig)
        while True:
            t, q = read_encoders()                         # s; rad, (n,), in the order of rig.joints
            gyro, (w, f) = read_camera_gyro(), read_platform_imu()  # rad/s; rad/s and m/s², at rest (0, 0, 9.81)
            write_torques(controller.step(Measurement(t, q, gyro, w, f)))  # N m, (n,)

    All readings are in their links' frames. The torque is finite and within the motors' limits whatever the sensors
    say; `events` tells what failed. A step changes the object: one controller for one loop.

    From wherever the joints stand at the start the camera turns to the wanted attitude as fast as the rig's rates and
    torques let it; without a wanted attitude it is held where it looks at the start.

    Attributes:
        recipe: What the controller was made of: model, wanted attitude, sensors, the platform's spectrum.
        pointer: The calculation, which keeps nothing from step to step.
        keeps: Whether the camera is held where it looks at the start, whatever attitude the recipe has.
    """

    def __init__(self, recipe: Recipe, keeps: bool = False) -> None:
        """Make the controller that `verify` compares with a PID; all that a step needs is worked out here.

        Raises:
            UsageError: The rig cannot hold its camera so, or the gains are of a PID, or of another interval.
        """
        rig = recipe.model.rig
        law = recipe.law
        if isinstance(law, JointPid):
            raise UsageError(
                "controller",
                "is a PID",
                "tune one of computed torque: gimbal-pin tune --kind computed-torque",
            )
        if law is not None and law.dt != recipe.dt:
            raise UsageError(
                "controller", f"steps every {law.dt:g} s", f"tune one with --dt {recipe.dt:g}"
            )
        convert_value(int, recipe.delay, "delay", UsageError, (0, 50))
        rotation(recipe.wanted, "wanted", UsageError)
        if reason := unable(rig, recipe.wanted):
            raise UsageError(f"rig {rig.name}", f"cannot hold its camera: {reason}", "change that")
        made = recipe.pointer()
        self.pointer = replace(made, navigator=replace(made.navigator, level=Level(made.dt)))
        self.recipe, self.keeps = recipe, keeps
        self.memory: Held | None = None
        zero = np.zeros(3)
        up = np.array([0.0, 0.0, 9.81])
        links = len(self.pointer.navigator.sight.moved)
        self.shapes = ((rig.n,), (3,), (3,), (3,), (3 * links,))
        for k in range(WARM_UP):
            self.step(Measurement(k * self.dt, recipe.looking, zero, zero, up, np.zeros(3 * links)))
        self.memory = None

    @staticmethod
    def learn(
        rig: Rig,
        log: Log,
        wanted: Array | None = None,
        *,
        delay: int | None = None,
        noise: Noise | None = None,
        tuned: StoredController | None = None,
    ) -> Controller:
        """Identify the model and the platform's spectrum from a log.

        Args:
            rig: The rig.
            log: A log of it; its base should be shaken, with the base's IMU in the log.
            wanted: Attitude that the camera turns to and keeps in the world, (3, 3); `attitude(yaw, pitch)` makes one
                that looks along x at zero. None: the camera is held where it looks at the start.
            delay: Samples of 1 ms from a measurement to its torque; None: one, or those that `tuned` was made for.
            noise: Densities of the IMUs' noise; None: those that the rig's YAML states, else the benchmark's.
            tuned: A controller of `tune`, by `read_controller`: its model and gains; None: the model is identified in
                the log, and each loop has a disk margin of one.
        """
        stated = rig.config.noise
        own = noise or (stated if stated.gyro > 0 else Noise(GYRO, ACCELEROMETER))
        station = Station(Sensors.of(rig, DT).encoder_step, own)
        sight = Sight(rig)
        kept = sight.attitude(sight.home) if wanted is None else wanted
        model, law, usual = (
            (None, None, 1)
            if tuned is None
            else (tuned.model, tuned.law, tuned.wish.holding_samples)
        )
        recipe = learn_recipe(rig, log, station, model, kept, usual if delay is None else delay)
        return Controller(replace(recipe, law=law), wanted is None)

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return self.pointer.dt

    @property
    def events(self) -> tuple[str, ...]:
        """What happened since the start, in sentences."""
        return () if self.memory is None else self.memory.events

    def start(self, measurement: Measurement, platform: Array | None = None) -> Held:
        """Begin anew at a measurement, and return what is remembered of it.

        Args:
            measurement: The first one.
            platform: Attitude of the base link in the world, (3, 3); None: heading zero, level by its accelerometer:
                by one sample at first, and then by the mean of all in the gyros' world, see `Level`.

        Raises:
            UsageError: As `step` does, or the attitude is no rotation matrix.
        """
        self.check(measurement)
        base = (
            leveled(measurement.f)
            if platform is None
            else rotation(platform, "platform", UsageError)
        )
        q = measurement.q if np.isfinite(measurement.q).all() else np.zeros(len(measurement.q))
        camera = base @ self.pointer.navigator.sight.attitude(q)
        begun = self.pointer.start(measurement, camera, base)
        upright = Level(self.dt).start(sure=platform is not None)
        self.memory = begun._replace(known=begun.known._replace(upright=upright))
        if self.keeps:
            return self.hold()
        if why := self.obstacle(begun.known, base):
            self.memory = self.hold()._replace(
                noted=(f"{measurement.t:.3f} s: held where it looks: {why}",)
            )
        return self.memory

    def obstacle(self, known: Known, base: Array) -> str | None:
        """Return what keeps the camera from getting where it turns to, or None."""
        sight = self.pointer.navigator.sight
        return sight.obstacle(known.turns[-1].goal, base, known.wanted) if known.turns else None

    def attitude(self) -> Array:
        """Return where the camera looks by the controller's own estimate: its attitude in the world, (3, 3).

        Raises:
            UsageError: There was no measurement yet.
        """
        memory = self.begun()
        return self.pointer.navigator.camera(memory.known, memory.watch.good.q)

    def hold(self, wanted: Array | None = None) -> Held:
        """Turn the camera to an attitude in the world, (3, 3), and keep it; None: where it looks now.

        A turn that is on comes to rest first.

        Raises:
            UsageError: There was no measurement yet, it is no rotation matrix, or the joints' limits are before it.
        """
        memory = self.begun()
        camera = self.attitude()
        navigator = self.pointer.navigator
        goal = camera if wanted is None else rotation(wanted, "wanted", UsageError)
        q = memory.watch.good.q
        base = camera @ navigator.sight.attitude(q).T
        known = navigator.hold(memory.known, q, base, goal)
        if wanted is not None and (why := self.obstacle(known, base)):
            raise UsageError("wanted", why, "name an attitude within the joints' reach")
        self.memory = memory._replace(known=known)
        return self.memory

    def begun(self) -> Held:
        """Return the memory; raise `UsageError` before the first measurement."""
        if self.memory is None:
            raise UsageError(
                "controller", "has seen no measurement yet", "call start or step first"
            )
        return self.memory

    def step(self, measurement: Measurement) -> Array:
        """Return the torques for a measurement, N m, (n,); the first one starts the controller.

        Raises:
            UsageError: It is no `Measurement` of a number and arrays of numbers of this rig's sizes.
        """
        self.check(measurement)
        memory = self.start(measurement) if self.memory is None else self.memory
        torque, self.memory = self.pointer.torque(measurement, memory)
        return torque

    def check(self, measurement: Measurement) -> None:
        """Raise `UsageError` unless types and shapes are those of this rig's measurements."""
        if not isinstance(measurement, Measurement) or not isinstance(measurement.t, Real):
            raise UsageError(
                "measurement",
                "is none, or its time no number",
                "give Measurement(t, q, gyro, w, f)",
            )
        for name, values, shape in zip(Measurement._fields[1:], measurement[1:], self.shapes):
            own = (
                values.shape
                if isinstance(values, np.ndarray) and values.dtype.kind in "fiu"
                else None
            )
            if own != shape:
                what = f"is of the shape {own}" if own else "is no numpy array of numbers"
                links = ", ".join(gyros_between(self.recipe.model.rig)) if name == "links" else ""
                of = (
                    f": the rates of the gyros on {links}, rad/s, each in its link's frame"
                    if links
                    else ""
                )
                raise UsageError(f"measurement: {name}", what, f"give an array of {shape[0]}{of}")

    def save(self, path: str | Path) -> None:
        """Write model, gains, wanted attitude, sensors and the spectrum, of the flight if there was one, as JSON."""
        own = self.recipe
        law = self.recipe.law
        assert not isinstance(law, JointPid)  # none is made with one
        forecast = self.pointer.navigator.forecast
        spectrum = own.spectrum if self.memory is None else forecast.known(self.memory.known.past)
        write_json(
            {
                "schema": 1,
                "rig": own.model.rig.name,
                "payload": own.model.rig.payload,
                "joints": own.model.rig.joints,
                "wanted": None if self.keeps else own.wanted.ravel(),
                "dt": own.dt,
                "delay": own.delay,
                "encoder_step": own.step,
                "noise": vars(own.noise),
                "trusted": own.trusted,
                "spectrum": {**vars(spectrum), "f": float(spectrum.f[1])},
                "model": own.model.to_dict(),
                "gains": None if law is None else law.gains,
                "robust": None if law is None or law.robust is None else law.robust.to_dict(),
            },
            path,
        )

    @staticmethod
    def load(path: str | Path, rig: Rig) -> Controller:
        """Read what `save` wrote for this rig with this payload.

        Raises:
            ModelError: It is no such file, or one of another rig, payload or joints.
        """
        place = str(path)
        try:
            data = json.loads(read_bytes(path, ModelError, LARGEST_TEXT))
        except (ValueError, RecursionError):
            mend = "write one with Controller.save; a controller of 'tune' goes into Controller.learn(…, tuned=…)"
            raise ModelError(place, "is no controller's file", mend) from None
        with prefix_place(place, ModelError):
            stored = read_record(Stored, data, place, ModelError, others=True)
            if stored.schema != 1:
                raise ModelError(
                    f"{place}: schema",
                    f"is {stored.schema}",
                    "write it with this version, which reads 1",
                )
            if (stored.rig, stored.payload, stored.joints) != (rig.name, rig.payload, rig.joints):
                joints = ", ".join(stored.joints)
                what = f"is of {stored.rig} with {stored.payload or 'no payload'} and the joints {joints}"
                raise ModelError(place, what, f"learn one for {rig.title}")
            if len(stored.trusted) not in (0, rig.n):
                raise ModelError(
                    f"{place}: trusted",
                    "is not one value per joint",
                    "write it with Controller.save",
                )
            sight = Sight(rig)
            wanted = stored.wanted
            kept = (
                sight.attitude(sight.home)
                if wanted is None
                else rotation(wanted, f"{place}: wanted", ModelError)
            )
            model = read_model_data(stored.model, rig, f"{place}: model")
            law = None
            if stored.gains is not None:
                gains = tuple(Pid(*each) for each in stored.gains)
                if len(gains) != rig.n:
                    raise ModelError(
                        f"{place}: gains",
                        "are not one row per joint",
                        "write it with Controller.save",
                    )
                term = stored.robust
                robust = None if term is None else read_robust_term(term, gains, f"{place}: robust")
                law = ComputedTorque(model, gains, stored.dt, robust=robust)
            return Controller(
                Recipe(
                    model,
                    kept,
                    stored.spectrum.spectrum(f"{place}: spectrum"),
                    stored.noise,
                    stored.encoder_step,
                    stored.trusted,
                    dt=stored.dt,
                    delay=stored.delay,
                    law=law,
                ),
                wanted is None,
            )


@dataclass(frozen=True)
class StoredSpectrum:
    """A `Spectrum` in a file, its frequencies by their spacing, Hz."""

    f: float = bounded_field(0.5, 1e-3, 1e3)
    rate: tuple[float, ...] = bounded_field((), 0.0, 1e12)
    force: tuple[float, ...] = bounded_field((), 0.0, 1e12)
    rate_noise: float = bounded_field(0.0, 1e-30, 1e12)
    force_noise: float = bounded_field(0.0, 1e-30, 1e12)

    def spectrum(self, place: str) -> Spectrum:
        """Return it; `ModelError` if its two densities are of different lengths or too short."""
        if not 2 < len(self.rate) == len(self.force) <= 100_000:
            raise ModelError(
                place, "needs as many values of rate as of force", "write it with Controller.save"
            )
        f = self.f * np.arange(len(self.rate))
        return Spectrum(
            f, np.array(self.rate), np.array(self.force), self.rate_noise, self.force_noise
        )


@dataclass(frozen=True)
class Stored:
    """What `Controller.save` writes."""

    schema: int
    rig: str
    payload: str | None
    joints: tuple[str, ...]
    wanted: tuple[float, ...] | None
    model: Any
    spectrum: StoredSpectrum
    noise: Noise
    gains: tuple[tuple[float, float, float], ...] | None = None
    robust: Any = None
    trusted: tuple[bool, ...] = ()
    dt: float = bounded_field(0.001, 1e-5, 0.1)
    delay: int = bounded_field(1, 0, 50)
    encoder_step: float = bounded_field(0.0, 0.0, 1.0)


def rotation(entries: Sequence[float] | Array, place: str, error: type[GimbalPinError]) -> Array:
    """Return a rotation matrix from its nine entries; an `error` if they are none."""
    flat = np.ravel(entries)
    R = flat.reshape(3, 3) if len(flat) == 9 and flat.dtype.kind in "fiu" else np.zeros((3, 3))
    if not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0):
        raise error(place, "is no rotation matrix", "give its nine entries, row by row")
    return R
