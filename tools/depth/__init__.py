"""Measurement of depth from 2D landmarks alone: sets of hands, methods, scores, tables and drawings."""
