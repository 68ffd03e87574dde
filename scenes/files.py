"""Files that a scene file names."""

from __future__ import annotations

from pathlib import Path


def beside(scene_file: Path, name: str) -> Path:
    """The file that `scene_file` names relative to itself; programs on Windows write backslashes between folders."""
    return scene_file.parent / name.replace("\\", "/")
