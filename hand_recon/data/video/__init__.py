"""Frames of video files, streams, cameras and sequences of images, and videos that are written."""
