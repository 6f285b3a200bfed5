"""glTF files read by the specification: joints by walking the node tree, the figure by a library of its own."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import motions
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motiongen.formats.gltf import write_glb
from motiongen.motion import SMPL_JOINTS, Motion, Source

_WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def opened(path: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    """The JSON document and the arrays of its accessors, each (count, width)."""
    content = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    document = json.loads(content[20 : 20 + size])
    blob_size, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert kind == b"BIN\0"
    blob = content[28 + size :]
    assert len(blob) == blob_size == document["buffers"][0]["byteLength"]
    arrays = []
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        dtype = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        values = np.frombuffer(blob, dtype, view["byteLength"] // np.dtype(dtype).itemsize, view["byteOffset"])
        assert view["byteOffset"] % 4 == 0
        arrays.append(values.reshape(accessor["count"], _WIDTH[accessor["type"]]))
    return document, arrays


def world(document: dict[str, Any], poses: dict[tuple[int, str], np.ndarray]) -> np.ndarray:
    """Matrices (J, 4, 4) of the skin's joints; `poses` takes the place of a node's own translation or rotation."""
    nodes = document["nodes"]
    found: dict[int, np.ndarray] = {}

    def walk(index: int, above: np.ndarray) -> None:
        here = np.eye(4)
        here[:3, 3] = poses.get((index, "translation"), nodes[index].get("translation", [0, 0, 0]))
        here[:3, :3] = Rotation.from_quat(
            poses.get((index, "rotation"), nodes[index].get("rotation", [0, 0, 0, 1]))
        ).as_matrix()
        found[index] = above @ here
        for child in nodes[index].get("children", []):
            walk(child, found[index])

    for root in document["scenes"][document["scene"]]["nodes"]:
        walk(root, np.eye(4))
    return np.array([found[j] for j in document["skins"][0]["joints"]])


def at_frame(document: dict[str, Any], arrays: list[np.ndarray], frame: int) -> np.ndarray:
    animation = document["animations"][0]
    samplers = animation["samplers"]
    return world(
        document,
        {
            (c["target"]["node"], c["target"]["path"]): arrays[samplers[c["sampler"]]["output"]][frame]
            for c in animation["channels"]
        },
    )


@pytest.mark.parametrize("clip", [motions.walk(), motions.flail()], ids=["walk", "flail"])
def test_the_node_tree_puts_every_joint_where_the_motion_has_it(tmp_path: Path, clip: Motion) -> None:
    write_glb(clip, tmp_path / "m.glb")
    document, arrays = opened(tmp_path / "m.glb")
    names = [document["nodes"][j]["name"] for j in document["skins"][0]["joints"]]
    assert names == list(SMPL_JOINTS)
    times = arrays[document["animations"][0]["samplers"][0]["input"]].ravel()
    np.testing.assert_allclose(times, np.arange(len(clip)) / clip.fps, atol=1e-6)
    for frame in (0, len(clip) // 3, len(clip) - 1):
        x, y, z = at_frame(document, arrays, frame)[:, :3, 3].T  # y up, facing z
        np.testing.assert_allclose(np.stack([z, x, y], axis=1), clip.positions()[frame], atol=1e-6)


def test_rotations_take_the_short_way_between_frames(tmp_path: Path) -> None:
    clip = motions.flail()
    quat = clip.joint_quat.copy()
    quat[::2] *= -1  # the same rotations
    write_glb(replace(clip, joint_quat=quat), tmp_path / "m.glb")
    document, arrays = opened(tmp_path / "m.glb")
    for sampler in document["animations"][0]["samplers"][1:]:
        turns = arrays[sampler["output"]]
        assert (np.sum(turns[1:] * turns[:-1], axis=1) > 0).all()


def test_the_bind_pose_is_a_t_pose_on_the_floor_and_undone_by_the_skin(tmp_path: Path) -> None:
    clip = motions.walk()
    write_glb(clip, tmp_path / "m.glb")
    document, arrays = opened(tmp_path / "m.glb")
    rest = world(document, {})
    inverse = arrays[document["skins"][0]["inverseBindMatrices"]].reshape(-1, 4, 4).swapaxes(1, 2)
    np.testing.assert_allclose(rest @ inverse, np.tile(np.eye(4), (22, 1, 1)), atol=1e-6)
    at = dict(zip(SMPL_JOINTS, rest[:, :3, 3], strict=True))
    assert at["left_foot"][1] == pytest.approx(clip.skeleton.foot_height[1], abs=1e-6)
    arm = at["left_wrist"] - at["left_shoulder"]
    assert arm / np.linalg.norm(arm) == pytest.approx([1, 0, 0], abs=1e-6)


def test_the_figure_is_closed_and_every_part_follows_its_joint(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    clip = motions.walk()
    write_glb(clip, tmp_path / "m.glb")
    mesh = trimesh.load(tmp_path / "m.glb", force="mesh")
    parts = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True).split(only_watertight=True)
    assert len(parts) == 21 + 5  # bones, and what goes on past head, wrists and toes
    assert all(part.volume > 0 for part in parts)  # faces look outwards
    tall = mesh.bounds[1, 1] - mesh.bounds[0, 1]
    assert tall == pytest.approx(1.6, abs=0.1)

    document, arrays = opened(tmp_path / "m.glb")
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    places, owners = arrays[attributes["POSITION"]], arrays[attributes["JOINTS_0"]][:, 0]
    frame = len(clip) // 2
    inverse = arrays[document["skins"][0]["inverseBindMatrices"]].reshape(-1, 4, 4).swapaxes(1, 2)
    whole = np.append(places, np.ones((len(places), 1)), axis=1)
    skinned = (at_frame(document, arrays, frame) @ inverse)[owners] @ whole[..., None]
    drawn = skinned[:, [2, 0, 1], 0]
    for joint in clip.positions()[frame]:
        assert np.linalg.norm(drawn - joint, axis=1).min() < 1e-5  # every joint is the tip of a spindle


def test_licence_and_words_are_carried(tmp_path: Path) -> None:
    clip = replace(motions.stand(), source=Source("x", licence="CC BY 4.0"))
    write_glb(clip, tmp_path / "m.glb")
    document, _ = opened(tmp_path / "m.glb")
    assert document["asset"] == {"version": "2.0", "generator": "rigcast", "copyright": "CC BY 4.0"}
    assert document["animations"][0]["name"] == "stand"
