"""The player is where a clock says, whatever was pressed before."""

from __future__ import annotations

import pytest

from sim.player import REST, Player


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def player(clock):
    """101 frames at 50 a second: 2 s."""
    return Player(101, 50.0, clock)


@pytest.mark.parametrize("passed", [0.0, 0.02, 0.5, 1.98, 2.0])
def test_it_plays_at_real_speed(player, clock, passed):
    clock.now += passed
    assert player.frame == round(50 * passed)
    assert player.running


def test_at_its_end_it_rests_and_begins_anew(player, clock):
    clock.now += 2.02 + REST - 0.01
    assert player.frame == 100
    clock.now += 0.02
    assert player.frame == 0


def test_without_loop_it_stays_at_its_end_and_begins_anew_when_told(player, clock):
    player.loop = False
    clock.now += 60
    assert (player.frame, player.running) == (100, False)
    player.toggle()
    assert (player.frame, player.running) == (0, True)
    clock.now += 1
    assert player.frame == 50


def test_a_pause_holds_the_frame_and_goes_on_from_there(player, clock):
    clock.now += 0.5
    player.toggle()
    clock.now += 1000
    assert (player.frame, player.running) == (25, False)
    player.toggle()
    clock.now += 0.1
    assert (player.frame, player.running) == (30, True)


@pytest.mark.parametrize(("steps", "frame"), [((1,), 26), ((-1, -1), 23), ((1000,), 100), ((-1000,), 0)])
def test_a_step_pauses(player, clock, steps, frame):
    clock.now += 0.5
    for step in steps:
        player.step(step)
        clock.now += 5
    assert (player.frame, player.running) == (frame, False)


@pytest.mark.parametrize(("to", "frame"), [(40, 40), (-3, 0), (500, 100)])
def test_it_plays_on_from_where_it_is_put(player, clock, to, frame):
    player.seek(to)
    assert player.frame == frame
    clock.now += 0.2
    assert player.frame == min(frame + 10, 100)


def test_to_loop_or_not_moves_nothing(player, clock):
    clock.now += 1.0
    player.loop = False
    assert player.frame == 50
    player.loop = True
    clock.now += 0.2
    assert player.frame == 60
    clock.now = 100 + 2.5  # resting, then asked not to begin anew
    player.loop = False
    assert (player.frame, player.running) == (100, False)


def test_one_frame_is_enough(clock):
    still = Player(1, 50.0, clock)
    clock.now += 7
    assert still.frame == 0
