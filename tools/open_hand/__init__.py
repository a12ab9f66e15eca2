"""Parts of `tools/build_open_hand.py`: from MakeHuman's data to the hand in `hand_recon/hand/assets`."""
