"""Hands of millions of images: columns of Daft, on one machine or on Ray's cluster (docs/scale.md)."""

from hand_recon.scale.columns import audit_hands, fit_hands, reconstruct_hands

__all__ = ["audit_hands", "fit_hands", "reconstruct_hands"]
