"""Shading of samples on surfaces: materials, lights, shadow maps, environment maps and the sky."""
