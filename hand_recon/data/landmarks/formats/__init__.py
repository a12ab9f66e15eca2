"""Landmark files as detectors and annotation tools write them; one module for each tool."""
