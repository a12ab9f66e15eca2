"""Tests of the second-order fit."""
