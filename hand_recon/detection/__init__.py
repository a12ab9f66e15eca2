"""Hands in images: MediaPipe's two networks, with pre- and postprocessing of this project (decision 53).

The palm network finds palms in the whole image, the landmark network 21 landmarks in a square around each.
Zhang et al., "MediaPipe Hands: On-device Real-time Hand Tracking", 2020, arXiv:2006.10214.
"""
