"""The timeline of the page: a slider over the motion, and buttons to play, pause, step and loop it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.player import Player
from sim.preview import Preview

if TYPE_CHECKING:
    import viser

AGAIN = 1e-5  # s: browsers that were told another moment while they dragged are told again, and viser sends only news
BACK, ON, START = "back", "on", "start"


class Timeline:
    """Moves `player`, which is that of the motion that was loaded last, and shows where it is."""

    def __init__(self, gui: viser.GuiApi, preview: Preview) -> None:
        self.player = Player(len(preview), preview.fps)
        self._dragged_since = False  # the last refresh
        with gui.add_folder("Timeline"):
            self._time = gui.add_slider("seconds", min=0.0, max=1.0, step=0.01, initial_value=0.0)
            self._play = gui.add_button("pause")
            self._step = gui.add_button_group("frame", (START, BACK, ON))
            self._loop = gui.add_checkbox("over and over", True)
        self.load(preview)
        self._play.on_click(lambda _: self.player.toggle())
        self._step.on_click(lambda event: self._stepped(event.target.value))
        self._time.on_update(self._dragged)
        self._loop.on_update(lambda _: setattr(self.player, "loop", self._loop.value))

    def load(self, preview: Preview) -> None:
        """Begin with another motion, at its first frame."""
        self.player = Player(len(preview), preview.fps)
        self.player.loop = self._loop.value
        self._time.max = max(len(preview) - 1, 1) / preview.fps
        self.refresh()

    def refresh(self) -> None:
        """Let slider and button say what the player does."""
        player = self.player
        at, moved = player.frame / player.fps, self._dragged_since
        self._dragged_since = False
        if moved and abs(self._time.value - at) < AGAIN:
            at += AGAIN
        if moved or abs(self._time.value - at) > 0.5 / player.fps:
            self._time.value = at  # type: ignore[misc]  # viser sets it apart from its property
        label = "pause" if player.running else "play"
        if self._play.label != label:
            self._play.label = label

    def _dragged(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client_id is not None:  # a person, not `refresh`
            self.player.hold(round(event.target.value * self.player.fps))
            self._dragged_since = True

    def _stepped(self, way: str) -> None:
        if way == START:
            self.player.seek(0)
        else:
            self.player.step(1 if way == ON else -1)
