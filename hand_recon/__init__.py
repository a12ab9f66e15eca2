"""Monocular 3D hand reconstruction that learns from 2D landmarks alone (ECCV 2024)."""

__version__ = "0.2.0"
