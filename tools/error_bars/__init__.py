"""Measurement of 3D error bars: errors beside covariances, fitted corrections, tables."""
