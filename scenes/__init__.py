"""Scenes: the model, loaders, repair, procedural scenes, camera paths."""
