"""What a service tells Prometheus."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.control import Status
from drivers.messages import Mode
from drivers.metrics import Metric
from drivers.publisher import Publisher

MODES: tuple[Mode, ...] = ("waiting", "following", "hold", "safe", "stopped", "tripped")
SERVICE_MODES = ("idle", "playing", "resting", "stopped")


def figures(
    status: Status, publisher: Publisher, counts: Mapping[str, int], outcomes: Mapping[str, int], maker_starts: int
) -> tuple[Metric, ...]:
    """All of it. Counts begin with 0 when the service starts."""

    def counter(name: str, help: str, count: int) -> Metric:
        return Metric(f"rigcast_{name}_total", "counter", help, (({}, count),))

    def by(name: str, label: str, help: str, found: Mapping[str, int]) -> Metric:
        return Metric(f"rigcast_{name}_total", "counter", help, tuple(({label: k}, v) for k, v in found.items()))

    rigs = [({"rig": m.state.rig, "sender": m.sender, "run": f"{m.state.run:08x}"}, m) for m in publisher.roster]
    return (
        counter("frames", "Frames that were sent.", counts["frames"]),
        counter("late_frames", "Frames that left over a millisecond late.", counts["late"]),
        counter("cuts", "Motions that gave way to another.", counts["cuts"]),
        counter("cuts_rejected", "Cuts that the gate refused; others were tried further on.", counts["cuts_rejected"]),
        counter("maker_starts", "Starts of the processes that make motions.", maker_starts),
        by("prompts", "outcome", "Prompts by what became of them.", outcomes),
        by("refused", "why", "Messages and connections that were turned away.", publisher.refused),
        Metric("rigcast_waiting", "gauge", "Prompts that wait.", (({}, len(status.waiting)),)),
        Metric(
            "rigcast_mode",
            "gauge",
            "1 for the mode of the service.",
            tuple(({"mode": mode}, status.mode == mode) for mode in SERVICE_MODES),
        ),
        Metric(
            "rigcast_rig_mode",
            "gauge",
            "1 for the mode of a rig.",
            tuple(({**who, "mode": mode}, m.state.mode == mode) for who, m in rigs for mode in MODES),
        ),
        Metric(
            "rigcast_rig_temperature_celsius",
            "gauge",
            "The hottest servo of a rig.",
            tuple((who, max(m.state.temperature)) for who, m in rigs if m.state.temperature),
        ),
        Metric(
            "rigcast_rig_current_amperes",
            "gauge",
            "All servos of a rig together.",
            tuple((who, sum(map(abs, m.state.current))) for who, m in rigs if m.state.current),
        ),
        Metric(
            "rigcast_clock_offset_seconds",
            "gauge",
            "The clock of a rig less ours.",
            tuple((who, m.offset.seconds) for who, m in rigs),
        ),
        Metric(
            "rigcast_clock_error_seconds",
            "gauge",
            "What the offset may be off by: half the way there and back.",
            tuple((who, m.offset.error_s) for who, m in rigs),
        ),
    )
