"""Who follows a stream, and whose clock is how far off."""

import pytest
from small_rig import small_rig

from drivers.messages import RigState
from drivers.offset import REMEMBERED, Offset
from drivers.roster import MOST_RIGS, Roster

RIG = small_rig()
S = 1_000_000_000
MS = 1_000_000


def state(mode: str = "following", rig: str = "small", run: int = 1, **times: int) -> RigState:
    return RigState(rig, RIG.hash, mode, "", 0, times.pop("time_ns", 0), (0.0,), run=run, **times)


@pytest.mark.parametrize("offset", [0, 3 * S, -3 * S])
def test_the_offset_is_found_to_within_what_it_says(offset: int) -> None:
    found = Offset()
    assert (found.seconds, found.error_s) == (0.0, float("inf"))
    for k, (there, back) in enumerate([(30, 5), (2, 20), (3, 2), (40, 1)]):
        sent = 100 * S + k * S
        heard = sent + there * MS + offset
        answered = heard + 7 * MS
        found.note(sent, heard, answered, answered + back * MS - offset)
    assert found.error_s == pytest.approx(0.0025)
    assert abs(found.seconds - offset / S) <= found.error_s
    assert found.seconds == pytest.approx(offset / S + 0.0005)


def test_what_cannot_be_is_left_out_and_a_moved_clock_is_forgotten_in_time() -> None:
    offset = Offset()
    offset.note(10, 20, 15, 40)  # answered before it was heard
    offset.note(10, 20, 30, 12)  # back before it was there
    assert offset.error_s == float("inf")
    for k in range(REMEMBERED + 1):
        step = 0 if k == 0 else S
        offset.note(k, k + step + 5 + k, k + step + 5 + k, k + 10 + 2 * k)
    assert offset.seconds == pytest.approx(1.0, abs=1e-6)


def test_the_roster_measures_the_clock_of_each_rig() -> None:
    roster = Roster()
    roster.note("pi", state(frame_ns=5 * S, heard_ns=9 * S + 2 * MS, time_ns=9 * S + 4 * MS), 5 * S + 6 * MS)
    [member] = roster
    assert (member.sender, member.offset.seconds, member.offset.error_s) == ("pi", 4.0, 0.002)


def test_a_rig_that_is_not_well_stays_so_until_it_was_started_anew() -> None:
    roster = Roster()
    roster.note("", state("following"), 0)
    assert roster.unwell() == ""
    for mode in ("tripped", "stopped", "safe"):
        roster.note("", state(mode), S)
        assert roster.unwell().startswith(f"small is {mode}")
    roster.note("", state("following", run=2), S + 1)  # another of its kind, which was there all along
    assert roster.unwell().startswith("small is safe")
    roster.note("", state("waiting", run=3), 3 * S)  # this one took the place of the first
    assert roster.unwell() == ""
    assert len(list(roster)) == 1


def test_others_can_go_on_without_it() -> None:
    roster = Roster()
    roster.note("", state("tripped"), 0)
    roster.note("", state("following", rig="other"), 0)
    roster.forget_unwell()
    assert (roster.unwell(), [m.state.rig for m in roster]) == ("", ["other"])


def test_strangers_who_claim_to_be_rigs_fill_no_memory() -> None:
    roster = Roster()
    for k in range(1000):
        roster.note("", state(rig=f"r{k}"), k)
    assert len(list(roster)) == MOST_RIGS
    assert max(m.state.rig for m in roster) == "r999"
