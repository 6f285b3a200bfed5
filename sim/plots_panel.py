"""Plots beside the picture on the page: torque and speed of a joint between their limits, and balance over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.preview import Preview
from sim.report_page import BALANCE_KEY, JOINT_KEY, balance_plot, speed_plot, torque_plot

if TYPE_CHECKING:
    import viser

WIDTH = 400  # pixels


class PlotsPanel:
    """A panel at the left: the joint that has the most to give is shown first, others by choice."""

    def __init__(self, server: viser.ViserServer, preview: Preview) -> None:
        self._preview, self._drawn = preview, (-1, "")
        panel = server.gui.add_panel()
        with panel.add_tab("What its servos give"):
            self._joint = server.gui.add_dropdown("joint", tuple(j.name for j in preview.rig.joints))
            self._plots = server.gui.add_html("")
        panel.dock_left()
        panel.set_width(WIDTH)
        self.load(preview)

    def load(self, preview: Preview) -> None:
        """Show another motion of the same rig, from its worst joint on."""
        self._preview, self._drawn = preview, (-1, "")
        names = [preview.rig.joints[i].name for i in preview.load.worst_first()]
        self._joint.options = tuple(names)
        self._joint.value = names[0]  # type: ignore[misc]  # viser sets it apart from its property
        self.refresh(0)

    def refresh(self, frame: int) -> None:
        """Draw the chosen joint's plots, `frame` marked in them, unless that is what is drawn already."""
        if (frame, self._joint.value) == self._drawn:
            return
        self._drawn = frame, self._joint.value
        preview, now_s = self._preview, frame / self._preview.fps
        joint = preview.rig.joint_names().index(self._joint.value)
        parts = [JOINT_KEY, torque_plot(preview, joint, now_s=now_s), speed_plot(preview, joint, now_s=now_s)]
        if balance := balance_plot(preview, now_s=now_s):
            parts += [BALANCE_KEY, balance]
        self._plots.content = "".join(f'<div style="{STYLE}">{part}</div>' for part in parts)


STYLE = "font-size:13px;line-height:1.3;padding:0.3em 0.5em"
