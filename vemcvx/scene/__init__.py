"""Scenes (sets of effects), and scenes posed on a mesh."""

from vemcvx.scene.pose import PosedScene, pose_scene, pose_unchecked, suppress_scene_warnings
from vemcvx.scene.rows import ContactRows, jump_rows
from vemcvx.scene.scene import InitialStresses, Scene, contributions, initial_stresses

__all__ = [
    "ContactRows",
    "InitialStresses",
    "PosedScene",
    "Scene",
    "contributions",
    "initial_stresses",
    "jump_rows",
    "pose_scene",
    "pose_unchecked",
    "suppress_scene_warnings",
]
