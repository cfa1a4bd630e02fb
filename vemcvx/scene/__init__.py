"""Scenes: what is to be simulated, free of any mesh, and how it is posed on one."""

from vemcvx.scene.pose import PosedScene, pose_scene
from vemcvx.scene.scene import Scene

__all__ = ["PosedScene", "Scene", "pose_scene"]
