"""Our BVH and glTF files opened in Blender: joints where the motion has them, bones that Blender keeps. Needs `bpy`."""

from __future__ import annotations

from pathlib import Path

import motions
import numpy as np
import pytest

from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.gltf import write_glb
from motiongen.motion import SMPL_JOINTS

bpy = pytest.importorskip("bpy", reason="Blender's module bpy is not installed")
# Blender's BVH importer leaves the file to the garbage collector to close.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
FPS = 30
CLIP = motions.walk(fps=FPS)
FRAMES = (0, 30, 60, 90, 120)


def opened(path: Path) -> tuple[object, int]:
    """The armature in a file, and Blender's number of the first frame. Blender's z is up, its figure faces -y."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = FPS
    if path.suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path), global_scale=0.01, axis_forward="-Z", axis_up="Y")
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))
    armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
    return armature, round(bpy.data.actions[0].frame_range[0])


def ours(points: list[object]) -> np.ndarray:
    x, y, z = np.array(points).T
    return np.stack([-y, x, z], axis=1)


@pytest.mark.parametrize("suffix", [".bvh", ".glb"])
def test_blender_puts_every_joint_where_the_motion_has_it(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"walk{suffix}"
    (write_bvh if suffix == ".bvh" else write_glb)(CLIP, path)
    armature, first = opened(path)
    assert {bone.name for bone in armature.data.bones} == set(SMPL_JOINTS)  # type: ignore[attr-defined]
    for frame in FRAMES:
        bpy.context.scene.frame_set(first + frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())  # type: ignore[attr-defined]
        heads = [posed.matrix_world @ posed.pose.bones[name].head for name in SMPL_JOINTS]
        assert np.abs(ours(heads) - CLIP.positions()[frame]).max() < 1e-3


@pytest.mark.parametrize("suffix", [".bvh", ".glb"])
def test_the_rest_pose_is_the_t_pose(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"walk{suffix}"
    (write_bvh if suffix == ".bvh" else write_glb)(CLIP, path)
    armature, _ = opened(path)
    bones = armature.data.bones  # type: ignore[attr-defined]
    heads = ours([armature.matrix_world @ bones[name].head_local for name in SMPL_JOINTS])  # type: ignore[attr-defined]
    parents = list(CLIP.skeleton.parents)
    np.testing.assert_allclose((heads - heads[parents])[1:], CLIP.skeleton.offsets[1:], atol=1e-3)
    assert min(bone.length for bone in bones) > 1e-3  # Blender drops bones of no length
    assert armature.scale[:] == pytest.approx([1, 1, 1])  # type: ignore[attr-defined]


def test_the_skin_follows(tmp_path: Path) -> None:
    write_glb(CLIP, tmp_path / "walk.glb")
    _, first = opened(tmp_path / "walk.glb")
    bpy.context.scene.frame_set(first + FRAMES[2])
    figure = next(o for o in bpy.data.objects if o.name == "figure")
    mesh = figure.evaluated_get(bpy.context.evaluated_depsgraph_get())
    drawn = ours([mesh.matrix_world @ v.co for v in mesh.data.vertices])
    for joint in CLIP.positions()[FRAMES[2]]:
        assert np.linalg.norm(drawn - joint, axis=1).min() < 1e-3
