"""A rig is data: `rig.toml` read into frozen types. Loading one needs neither mujoco nor torch."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

from motiongen.motion import SMPL_JOINTS
from retarget.menagerie import menagerie_file
from retarget.servos import BOARDS, PROTOCOLS, PWM, ServoModel, servo_models
from retarget.table import RigError, Table, known, read_toml, unique

Mount = Literal["free", "stand", "hung"]
OnFault = Literal["limp", "rest"]
MOUNTS: tuple[Mount, ...] = ("free", "stand", "hung")
BUILT_IN = Path(__file__).parent / "rigs"
RIG_PATH = "RIGCAST_RIGS"  # environment variable: more folders of rigs

# At 70 % of its no-load speed a motor has 30 % of its stall torque left for the load: motions are planned below that.
PLANNED_SPEED = 0.7
# A joint without an `acceleration` of its own gets to its planned speed in this time, s. That is gentler than a servo
# that moves a light limb and harsher than nearly all that people do.
GETS_UP = 0.05
# Position servos give full torque at this error. 0.1 rad is stiff enough to hold a pose and soft enough for one frame's
# step at planned speed (about 0.07 rad at 50 Hz) not to saturate.
FULL_TORQUE_ERROR = 0.1
# Damping acts as one control period of lag at 50 Hz: kv = kp · 20 ms.
DAMPING_TIME = 0.02
# A servo that draws four fifths of its stall current for longer than a moment is stuck, or soon too hot.
SAFE_CURRENT = 0.8
# Below where the servos cut themselves off: AX and STS 70 °C, Dynamixel X 80 °C as they come from the factory.
SAFE_TEMPERATURE = 65.0


@dataclass(frozen=True)
class Joint:
    """One actuated joint. Limits in radians, `velocity` rad/s, `acceleration` rad/s² and `torque` N·m at most, `kp`
    N·m/rad, `kv` N·m·s/rad.

    `no_load_speed` rad/s: the torque that is left falls to nothing there. `friction` N·m, dry: None: as in the model.
    """

    name: str
    lower: float
    upper: float
    velocity: float
    torque: float
    no_load_speed: float
    kp: float
    kv: float
    friction: float | None = None
    acceleration: float = math.inf


@dataclass(frozen=True)
class Servo:
    """Which servo on which bus turns a joint. Direction and zero belong to one unit, not to the rig.

    `current_limit` A and `temperature_limit` °C: beyond them a drive lets go; None: what the model's may be.
    """

    joint: str
    bus: str
    id: int
    model: ServoModel
    current_limit: float | None = None
    temperature_limit: float | None = None

    @property
    def max_current(self) -> float:
        """What it may draw for longer than a moment, A."""
        return SAFE_CURRENT * self.model.stall_current if self.current_limit is None else self.current_limit

    @property
    def max_temperature(self) -> float:
        """How hot it may get, °C."""
        return SAFE_TEMPERATURE if self.temperature_limit is None else self.temperature_limit


@dataclass(frozen=True)
class Bus:
    """A servo bus: wire protocol and baud rate."""

    name: str
    protocol: str
    baud: int


@dataclass(frozen=True)
class Follow:
    """`body` (or site) of the rig follows `human` joint: `position` and `rotation` are weights of the IK task."""

    body: str
    human: str
    position: float
    rotation: float


@dataclass(frozen=True)
class Site:
    """A point that the rig adds to a model, or moves there: `pos` in metres in the frame of `body`."""

    name: str
    body: str
    pos: tuple[float, float, float]


@dataclass(frozen=True)
class Foot:
    """A foot: `body`, and the heel and toe sites on its sole; `human` is the ankle it stands for.

    `upright`: by how many rad the target of a joint of its leg moves, while it stands, per rad that the root leans more
    than it should to the right and forward.
    """

    name: str
    body: str
    sites: tuple[str, ...]
    human: str
    upright: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Pose:
    """A named pose: root height in metres (sole on the floor), joint angles in radians by name; the rest are zero."""

    height: float
    joints: dict[str, float]


@dataclass(frozen=True)
class Sensors:
    """What the rig can feel; `delay` in seconds from the world to the controller. `full_state`: where its root is in
    the world and how fast it moves, as motion capture or a simulation knows.
    """

    encoders: bool
    imu: bool
    delay: float
    full_state: bool = False


@dataclass(frozen=True)
class Power:
    """Supply: volts, and the amperes it can give."""

    voltage: float
    current: float


@dataclass(frozen=True)
class Rig:
    """A robot as data; see `docs/rigs.md` for the file.

    `joints` are in MuJoCo's qpos order and so are all joint vectors of this project. `stand_clearance` in metres: how
    high the soles hang above the floor on the stand. `model` is relative where it was looked for and is not here.
    `ahead` s: how much of the rate at which the root leans counts as lean (see `Foot.upright`).
    `on_fault`: what the other servos do when one fails: let go too, or go to the safe pose first, then let go.
    `damping` in N·m·s/rad goes before the model's, where that is a controller's and not the bearings'.
    """

    name: str
    folder: Path
    model: Path
    root: str
    mount: Mount
    stand_clearance: float
    joints: tuple[Joint, ...]
    follow: tuple[Follow, ...]
    feet: tuple[Foot, ...]
    nominal: Pose
    safe: Pose
    sensors: Sensors
    power: Power | None
    buses: tuple[Bus, ...]
    servos: tuple[Servo, ...]
    sites: tuple[Site, ...] = ()
    ahead: float = 0.0
    damping: float | None = None
    on_fault: OnFault = "limp"

    def supply(self, servo: Servo) -> float:
        """Voltage at `servo` over that at which it is rated; 1 where the rig does not tell its supply."""
        return 1.0 if self.power is None else servo.model.at_supply(self.power.voltage)

    def joint_names(self) -> tuple[str, ...]:
        """Names in qpos order."""
        return tuple(j.name for j in self.joints)

    def pose_vector(self, pose: Pose) -> list[float]:
        """Joint angles (nj,) in radians of `pose`, in qpos order."""
        return [pose.joints.get(j.name, 0.0) for j in self.joints]

    @property
    def hash(self) -> int:
        """64 bits over joint names, order, units and limits; not over colours, servos or gains."""
        text = "rad;" + ";".join(f"{j.name}:{j.lower:.6f}:{j.upper:.6f}:{j.velocity:.6f}" for j in self.joints)
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def list_rigs() -> tuple[str, ...]:
    """Names of the rigs in the built-in folder and in the folders of RIGCAST_RIGS, sorted."""
    return tuple(sorted({path.parent.name for folder in _rig_folders() for path in folder.glob("*/rig.toml")}))


def load_rig(name_or_path: str | Path, model: Path | None = None) -> Rig:
    """Read a rig by its name, or by the path of its folder or of its `rig.toml`; see `docs/rigs.md` for the keys.

    `model` is an MJCF to use instead of the one that the file names. The folders of RIGCAST_RIGS come before the
    built-in one. Raises RigError in one line: no such rig, or what in the file is wrong and what would be right.
    """
    file = _find(name_or_path)
    try:
        rig = read_toml(file).all(partial(_rig, file.parent))
        return rig if model is None else replace(rig, model=model.resolve())
    except RigError as problem:
        text = str(problem)
        raise RigError(text if text.startswith(str(file)) else f"{file}: {text}") from None


def _rig_folders() -> list[Path]:
    return [Path(p) for p in os.environ.get(RIG_PATH, "").split(os.pathsep) if p] + [BUILT_IN]


def _find(name_or_path: str | Path) -> Path:
    if isinstance(name_or_path, str) and os.sep not in name_or_path and "/" not in name_or_path:
        for folder in _rig_folders():
            if (folder / name_or_path / "rig.toml").is_file():
                return (folder / name_or_path / "rig.toml").resolve()
    path = Path(name_or_path)
    file = path / "rig.toml" if path.is_dir() else path
    if not file.is_file() or file.name != "rig.toml":
        raise RigError(f"no rig {str(name_or_path)!r}; known are {', '.join(list_rigs())}, or the path of a rig folder")
    return file.resolve()


def _rig(folder: Path, t: Table) -> Rig:
    buses = t.tables("bus", lambda b: Bus(b.text("name"), b.choice("protocol", PROTOCOLS), b.integer("baud", 1, 10**8)))
    driven = t.tables("servo", partial(_servo, {b.name: b.protocol for b in buses}))
    plain = t.tables("joint", lambda j: _joint(j.text("name"), j, j.number("torque"), j.number("no_load_speed")))
    joints = tuple(joint for joint, _ in driven) + plain
    servos = tuple(servo for _, servo in driven)
    if not joints or (driven and plain):
        raise RigError("give every joint as [[servo]], or every joint as [[joint]]")
    unique([j.name for j in joints], "joint")
    unique([(s.bus, s.id) for s in servos], "servo id (bus, id)")
    feet = t.tables("foot", partial(_foot, [j.name for j in joints]))
    unique([f.name for f in feet], "foot")
    root, follow = t.text("root"), t.tables("follow", _follow)
    unique([f.human for f in follow], "follow: human joint")
    if root not in [f.body for f in follow if f.human == "pelvis"] or not any(f.position or f.rotation for f in follow):
        raise RigError(
            f"follow: the root {root!r} should follow the pelvis, and something should have a weight above 0"
        )
    return Rig(
        name=folder.name,
        folder=folder,
        model=_model(folder, t),
        root=root,
        mount=t.choice("mount", MOUNTS),
        stand_clearance=t.number("stand_clearance", 0.05),
        joints=joints,
        follow=follow,
        feet=feet,
        nominal=t.table("nominal", partial(_pose, joints)),
        safe=t.table("safe", partial(_pose, joints)),
        sensors=t.table(
            "sensors",
            lambda s: Sensors(s.flag("encoders"), s.flag("imu"), s.number("delay"), s.flag("full_state", False)),
        ),
        power=t.table(
            "power", lambda p: Power(p.number("voltage", positive=True), p.number("current", positive=True)), None
        ),
        buses=buses,
        servos=servos,
        ahead=t.number("ahead", 0.0),
        damping=t.number("damping") if "damping" in t.data else None,
        on_fault=t.choice("on_fault", ("limp", "rest"), "limp"),
        sites=t.tables("site", lambda s: Site(s.text("name"), s.text("body"), s.point("pos"))),
    )


def _model(folder: Path, t: Table) -> Path:
    theirs = t.text("menagerie", "")
    return menagerie_file(theirs) if theirs else folder / t.text("model", "model.xml")


def _joint(name: str, t: Table, torque: float, no_load_speed: float) -> Joint:
    lower, upper = t.span("limits")
    if torque <= 0 or no_load_speed <= 0:
        raise RigError(f"{t.where}: torque {torque} and no_load_speed {no_load_speed} should be above 0")
    kp = torque / FULL_TORQUE_ERROR
    velocity = PLANNED_SPEED * no_load_speed
    acceleration = t.number("acceleration", velocity / GETS_UP, positive=True)
    return Joint(name, lower, upper, velocity, torque, no_load_speed, kp, kp * DAMPING_TIME, acceleration=acceleration)


def _servo(buses: dict[str, str], t: Table) -> tuple[Joint, Servo]:
    model = servo_models()[t.choice("model", tuple(servo_models()))]
    bus = t.choice("bus", tuple(buses))
    if buses[bus] not in (BOARDS if model.protocol == PWM else (model.protocol,)):
        raise RigError(f"{t.where}: model {model.name} speaks {model.protocol}, bus {bus!r} {buses[bus]}")
    joint = _joint(t.text("joint"), t, model.stall_torque, model.no_load_speed)
    limits = [t.number(k, positive=True) if k in t.data else None for k in ("current_limit", "temperature_limit")]
    return joint, Servo(joint.name, bus, t.integer("id", 0, 252), model, *limits)


def _foot(joints: Sequence[str], t: Table) -> Foot:
    upright = t.table("upright", partial(_upright, joints), {})
    human = t.choice("human", ("left_ankle", "right_ankle"))
    return Foot(t.text("name"), t.text("body"), t.texts("sites"), human, upright)


def _upright(joints: Sequence[str], t: Table) -> dict[str, tuple[float, float]]:
    for name in t.data:
        known(name, joints, f"{t.where}: joint")
    return {name: t.pair(name) for name in t.data}


def _follow(t: Table) -> Follow:
    return Follow(t.text("body"), t.choice("human", SMPL_JOINTS), t.number("position", 0.0), t.number("rotation", 0.0))


def _pose(joints: Sequence[Joint], t: Table) -> Pose:
    pose = Pose(t.number("height", positive=True), t.numbers("joints"))
    by_name = {j.name: j for j in joints}
    for name in pose.joints:
        known(name, tuple(by_name), f"{t.where}: joint")
    for name, joint in by_name.items():
        angle = pose.joints.get(name, 0.0)
        if not joint.lower <= angle <= joint.upper:
            raise RigError(f"{t.where}: {name} = {angle} is outside its limits {joint.lower} to {joint.upper}")
    return pose
