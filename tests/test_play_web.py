"""The page as its user meets it: type a prompt, scrub, read why not; by its messages, and in a real browser."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from two_arm_rig import two_arm_motion, two_arm_rig

pytest.importorskip("viser", reason="needs rigcast[web]")
from browser import Tab, browser, chromium
from web_client import web_client

from motiongen.motion import Label
from retarget.rig import Rig
from sim.checks import judge
from sim.play_web import play_web
from sim.preview import Preview, prepare

FIELD = "document.querySelector('form input')"


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Rig:
    return two_arm_rig(tmp_path_factory.mktemp("rig"))


def made(rig: Rig, text: str, *, seconds: float = 1.0, fast: float = 0.0) -> Preview:
    """The left arm swings, `fast` rad/s: above 10 faster than its servo can."""
    motion = two_arm_motion(seconds=seconds, left=lambda t: 1.5 * np.sin(fast * t))
    motion = replace(motion, labels=(Label(0, seconds, text),))
    return prepare(motion, rig, *judge(motion, rig), "from a test")


class Maker:
    """Makes what is asked for; holds its breath where `held` is set, until `go`."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.asked, self.held, self.go = rig, [], False, threading.Event()

    def __call__(self, text, seed, tell):
        self.asked.append((text, seed))
        if self.held:
            assert self.go.wait(20)
        if text == "fly":
            raise ValueError("nobody here can <fly>")
        tell("told & done")
        return made(self.rig, text, seconds=2.0, fast=20.0 if text == "throw" else 0.5)


@contextmanager
def page(preview: Preview, **also) -> Iterator[str]:
    """The address of a page that is served meanwhile."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    stop, failed = threading.Event(), []

    def serve():
        try:
            play_web(preview, port=port, stop=stop, **also)
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=serve)
    with redirect_stderr(StringIO()) as said:  # capfd may lose what is written while it is read
        thread.start()
        while thread.is_alive() and "browser" not in said.getvalue():
            time.sleep(0.01)
    try:
        yield re.search(r"open (\S+) in a browser", said.getvalue())[1]
    finally:
        stop.set()
        thread.join(30)
    assert not thread.is_alive()
    assert failed == []


def test_a_prompt_takes_the_place_of_what_is_shown_and_a_refused_one_does_not(rig):
    maker = Maker(rig)
    with page(made(rig, "stand"), say=maker) as address, web_client(address) as client:
        client.wait(lambda c: "<b>stand</b>" in c.words())
        assert client.one("seconds")["max"] == pytest.approx(1.0)
        client.set("do", "swing")
        client.set("seed", 3)
        client.submit("Say it")
        client.wait(lambda c: "<b>swing</b></p>" in c.words())
        client.wait(lambda c: "told &amp; done" in c.words())
        client.wait(lambda c: c.one("seconds")["max"] == pytest.approx(2.0) and not c.one("do")["disabled"])
        for text, why in (
            ("fly", "nobody here can &lt;fly&gt;"),
            ("throw", "torque_saturation</b>"),
            ("<b>", "&lt;b&gt;"),
        ):
            client.set("do", text)
            client.submit("Say it")
            client.wait(lambda c, why=why: why in c.words() and not c.one("do")["disabled"])
            if text != "<b>":
                assert "<b>swing</b></p>" in client.words()
                assert "not done" in client.words()
        client.wait(lambda c: "<b>&lt;b&gt;</b></p>" in c.words())
    assert maker.asked == [("swing", 3), ("fly", 3), ("throw", 3), ("<b>", 3)]


def test_prompts_go_one_at_a_time_and_the_page_lives_meanwhile(rig):
    maker = Maker(rig)
    maker.held = True
    with page(made(rig, "stand"), say=maker) as address, web_client(address) as client:
        client.wait(lambda c: "<b>stand</b>" in c.words())
        client.set("do", "swing")
        client.submit("Say it")
        client.wait(lambda c: c.one("do")["disabled"])
        client.submit("Say it")  # as a browser does that has not heard of it yet
        client.set("seconds", 0.5)
        client.wait(lambda c: any(x.get("label") == "play" for x in c.controls.values()))  # it pauses there
        client.wait(lambda c: abs(c.one("seconds")["value"] - 0.5) < 1e-4)  # whatever was told on the way
        assert "<b>stand</b>" in client.words()
        maker.go.set()
        client.wait(lambda c: "<b>swing</b></p>" in c.words())
    assert maker.asked == [("swing", 0)]


def test_what_fails_is_shown_where_that_is_wanted(rig):
    with page(made(rig, "stand"), say=Maker(rig), unchecked=True) as address, web_client(address) as client:
        client.wait(lambda c: "<b>stand</b>" in c.words())
        client.set("do", "throw")
        client.submit("Say it")
        client.wait(lambda c: "<b>throw</b></p>" in c.words() and ">fail</b>" in c.words())


def test_a_file_has_no_line_to_type(rig):
    with page(made(rig, "stand")) as address, web_client(address) as client:
        client.wait(lambda c: "<b>stand</b>" in c.words())
        assert not any("Text" in c["type"] or "Form" in c["type"] for c in client.controls.values())


@pytest.mark.skipif(chromium() is None, reason="needs Chromium on the path or named by CHROMIUM")
def test_in_a_browser_a_prompt_is_typed_the_rig_moves_and_a_refusal_is_read(rig, monkeypatch):
    # Light from a picture looks better, but OpenGL in software takes 15 s to prepare it.
    monkeypatch.setattr("viser.SceneApi.configure_environment_map", lambda *args, **kwargs: None)
    with page(made(rig, "stand"), say=Maker(rig)) as address, browser(chromium(), (1150, 450)) as tab:
        tab.open(address)
        tab.wait("stand")
        tab.click(FIELD)
        tab.type("swing")
        tab.press("Enter", 13)
        tab.wait("told & done")
        assert "all 2" in tab.text()  # checks
        tab.click(FIELD)
        tab.evaluate(f"{FIELD}.select()")
        tab.type("fly")
        tab.press("Enter", 13)
        tab.wait("nobody here can <fly>")
        assert "swing" in tab.text()
        tab.evaluate("document.querySelector('.mantine-Notification-closeButton')?.click()")  # it lies over the rig
        put(tab, "Home", 36)
        tab.wait("play")  # it pauses where it was put
        before = rig_in(tab)
        put(tab, "End", 35)
        assert any((np.abs(rig_in(tab) - before).max(-1) > 40).mean() > 0.005 for _ in range(20))
        assert tab.evaluate("document.querySelectorAll('svg[role=img] path').length") > 4


def put(tab: Tab, key: str, code: int) -> None:
    """Press a key on the slider of the timeline."""
    tab.evaluate("document.querySelector('[role=slider]').focus()")
    tab.press(key, code)


def rig_in(tab: Tab) -> np.ndarray:
    """What is seen between the panels."""
    return np.asarray(tab.picture(), int)[:, 410:780]


def test_a_trajectory_of_another_rig_has_no_preview(rig):
    motion = two_arm_motion(seconds=0.1)
    with pytest.raises(ValueError, match="trajectory is for rig 'other' with 2 joints, not for 'two_arm'"):
        prepare(replace(motion, rig="other"), rig, *judge(motion, rig))
