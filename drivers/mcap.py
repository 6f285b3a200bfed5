"""A recording as MCAP, for Foxglove, Rerun and whatever else reads JSON in MCAP; needs the `mcap` package."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec

from drivers.frame import Frame, FrameError, decode
from drivers.messages import Hello, RigState, Stop, news_in, unpack
from drivers.recording import Channel, Record

SUFFIX = ".mcap"
NS = 1_000_000_000
NUMBER = {"type": "number"}
TEXT = {"type": "string"}


def _object(**fields: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": fields}


JOINT = _object(name=TEXT, position=NUMBER, velocity=NUMBER)
MEASURED = _object(name=TEXT, position=NUMBER, current=NUMBER, temperature=NUMBER, voltage=NUMBER)
XYZ = dict.fromkeys("xyz", NUMBER)
SCHEMAS: dict[str, tuple[str, dict[str, Any]]] = {
    "/joints": (
        "rigcast.Joints",
        _object(stream=NUMBER, seq=NUMBER, state=TEXT, report_id=TEXT, joints={"type": "array", "items": JOINT}),
    ),
    "/root": (
        "foxglove.PoseInFrame",
        _object(
            timestamp=_object(sec=NUMBER, nsec=NUMBER),
            frame_id=TEXT,
            pose=_object(position=_object(**XYZ), orientation=_object(**XYZ, w=NUMBER)),
        ),
    ),
    "/hello": ("rigcast.Hello", _object(rig=TEXT, text=TEXT, source=TEXT, licence=TEXT, rate_hz=NUMBER)),
    "/state": (
        "rigcast.State",
        _object(rig=TEXT, mode=TEXT, reason=TEXT, seq=NUMBER, joints={"type": "array", "items": MEASURED}),
    ),
    "/stop": ("rigcast.Stop", _object(reason=TEXT)),
    "/damaged": ("rigcast.Damaged", _object(channel=TEXT, bytes=NUMBER, error=TEXT)),
}


class McapRecorder:
    """Writes records to a new `.mcap` file; a context manager. A kill loses what is not yet in a chunk of 1 MiB.

    `utc_ns` and `monotonic_ns` are the two clocks at one moment: MCAP tells time in UTC. Of a frame with many samples
    it holds the first. Joints have their names once a hello has come. Raises FileExistsError, OSError.
    """

    def __init__(self, path: Path, utc_ns: int, monotonic_ns: int) -> None:
        from mcap.writer import Writer

        self._offset_ns = utc_ns - monotonic_ns
        self._names: tuple[str, ...] = ()
        self._file = open(path, "xb")  # noqa: SIM115
        self._writer = Writer(self._file)
        self._writer.start(library="rigcast")
        self._topics = {topic: self._register(topic, *schema) for topic, schema in SCHEMAS.items()}
        self._write = {Channel.FRAMES: self._frame, Channel.HELLO: self._hello, Channel.STOP: self._stop}

    def write(self, record: Record) -> None:
        """Append what `record` says; a damaged one as such."""
        utc_ns = record.time_ns + self._offset_ns
        try:
            self._write[record.channel](record.data, utc_ns)
        except FrameError as error:
            what = {"channel": record.channel.name.lower(), "bytes": len(record.data), "error": str(error)}
            self._say("/damaged", what, utc_ns)

    def close(self) -> None:
        """Write the index and close the file."""
        self._writer.finish()
        self._file.close()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _frame(self, data: bytes, utc_ns: int) -> None:
        frame = decode(data)
        self._say("/joints", _joints(frame, self._names), utc_ns, frame.seq)
        self._say("/root", _root(frame, utc_ns), utc_ns, frame.seq)

    def _hello(self, data: bytes, utc_ns: int) -> None:
        news = news_in(data)
        if isinstance(news, Hello):
            self._names = news.joints
            self._say("/hello", msgspec.to_builtins(news), utc_ns)
        else:
            self._say("/state", _measured(news, self._names), utc_ns)

    def _stop(self, data: bytes, utc_ns: int) -> None:
        self._say("/stop", {"reason": unpack(data, Stop).reason}, utc_ns)

    def _say(self, topic: str, what: dict[str, Any], utc_ns: int, sequence: int = 0) -> None:
        data = msgspec.json.encode(what)
        self._writer.add_message(self._topics[topic], utc_ns, data, utc_ns, sequence & 0xFFFFFFFF)

    def _register(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        from mcap.well_known import MessageEncoding, SchemaEncoding

        number = self._writer.register_schema(name, SchemaEncoding.JSONSchema, json.dumps(schema).encode())
        return self._writer.register_channel(topic, MessageEncoding.JSON, number)


def _named(names: tuple[str, ...], joints: int) -> tuple[str, ...]:
    return names if len(names) == joints else tuple(f"joint {k}" for k in range(joints))


def _measured(state: RigState, names: tuple[str, ...]) -> dict[str, Any]:
    """Of each servo what it can measure; a rig without a servo on every joint tells no names."""
    columns = {k: v for k in ("position", "current", "temperature", "voltage") if (v := getattr(state, k))}
    rows = zip(_named(names, len(state.position)), *columns.values(), strict=True)
    joints = [dict(zip(("name", *columns), row, strict=True)) for row in rows]
    return {"rig": state.rig, "mode": state.mode, "reason": state.reason, "seq": state.seq, "joints": joints}


def _joints(frame: Frame, names: tuple[str, ...]) -> dict[str, Any]:
    names = _named(names, frame.pos.shape[1])
    columns = zip(names, frame.pos[0].tolist(), frame.vel[0].tolist(), strict=True)
    return {
        "stream": frame.stream,
        "seq": frame.seq,
        "state": frame.state.name.lower(),
        "report_id": frame.report_id,
        "joints": [{"name": name, "position": p, "velocity": v} for name, p, v in columns],
    }


def _root(frame: Frame, utc_ns: int) -> dict[str, Any]:
    x, y, z, qw, qx, qy, qz = frame.root[0].tolist()
    return {
        "timestamp": {"sec": utc_ns // NS, "nsec": utc_ns % NS},
        "frame_id": "world",
        "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}},
    }
