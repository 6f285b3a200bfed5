"""The live views show the newest pose, end when told, and say what to do where they cannot open."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import numpy as np
import pytest
from displays import grab, virtual_display
from two_arm_rig import HEIGHT
from two_arm_rig import two_arm_rig as make_rig

from sim.view import view_native, view_web

ROOT = (np.array([0.0, 0.0, HEIGHT]), np.array([1.0, 0.0, 0.0, 0.0]))
ARM_UP, ARM_DOWN = np.array([1.5, 0.0]), np.array([-1.5, 0.0])


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def test_the_web_view_serves_a_page_and_the_newest_pose(tmp_path, monkeypatch, capfd):
    from mjviser import ViserMujocoScene

    shown, stop, port = [], threading.Event(), free_port()
    update = ViserMujocoScene.update_from_mjdata

    def watch(scene, data):
        update(scene, data)
        shown.append(data.qpos[7:].tolist())

    monkeypatch.setattr(ViserMujocoScene, "update_from_mjdata", watch)
    coming = iter([None, (*ROOT, ARM_UP), (*ROOT, ARM_DOWN)])
    pages, told, deadline = [], [], time.monotonic() + 30

    def poses():
        pose = next(coming, None)
        if time.monotonic() > deadline:
            stop.set()
        if pose is None and len(shown) == 3:
            told.append(capfd.readouterr())
            address = re.search(rf"open (http://127\.0\.0\.1:{port}/\S{{22}}/) in a browser", told[0].err)[1]
            with urllib.request.urlopen(address) as answer:
                pages.append(answer.read().decode())
            stop.set()
        return pose

    view_web(make_rig(tmp_path), poses, port=port, stop=stop)
    assert shown == [[0, 0], ARM_UP.tolist(), ARM_DOWN.tolist()]
    assert "<html" in pages[0].lower()
    assert told[0].out == capfd.readouterr().out == ""
    with socket.socket() as s:
        assert s.connect_ex(("127.0.0.1", port)) != 0  # closed behind it


def test_the_web_view_listens_to_this_machine_alone_and_says_when_the_port_is_taken(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(RuntimeError, match=f"port {port} is taken; choose another with --port"):
            view_web(make_rig(tmp_path), lambda: None, port=port)


@pytest.mark.skipif(sys.platform != "linux", reason="displays are an X11 and Wayland matter")
@pytest.mark.parametrize("display", ["", ":987"])
def test_no_display_is_one_line_that_names_the_other_ways(tmp_path, monkeypatch, display):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RuntimeError, match=r"display.*--view web, or write a film with --out FILE\.mp4 or \.gif$"):
        view_native(make_rig(tmp_path), lambda: None)


VIEWER = """
import sys, threading
from pathlib import Path
import numpy as np
sys.path[:0] = {path!r}
from test_view import ROOT
from two_arm_rig import two_arm_rig
from sim.view import view_native
stop = threading.Event()
threading.Thread(target=lambda: (sys.stdin.readline(), stop.set()), daemon=True).start()
shown = 0
def poses():
    global shown
    shown += 1
    if shown == 10:
        print("shown", flush=True)
    return (*ROOT, np.array([{arm}, 0.0]))
view_native(two_arm_rig(Path({folder!r})), poses, stop=stop)
"""


@pytest.fixture
def display():
    with virtual_display() as name:
        yield name


def test_the_window_shows_the_newest_pose_and_closes_when_told(tmp_path, display):
    pictures = []
    for arm in (1.2, -1.2):
        code = VIEWER.format(path=sys.path, arm=arm, folder=str(tmp_path))
        env = {**os.environ, "DISPLAY": display}
        pipe = subprocess.PIPE
        with subprocess.Popen([sys.executable, "-c", code], env=env, stdin=pipe, stdout=pipe, text=True) as viewer:
            try:
                assert viewer.stdout.readline() == "shown\n"
                pictures.append(grab(display, until=lambda screen: not pictures or differ(screen, pictures[0])))
                viewer.communicate("stop\n", timeout=20)
            finally:
                viewer.kill()  # nothing, once it has ended
        assert viewer.returncode == 0
    assert all(p.std() > 15 for p in pictures)
    assert differ(*pictures)


def differ(one: np.ndarray, other: np.ndarray) -> bool:
    return bool((np.abs(one - other).max(-1) > 60).mean() > 0.002)
