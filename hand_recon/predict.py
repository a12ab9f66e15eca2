"""Reconstruct the 3D hands of photographs and videos: landmarks found, and a fit with the knowledge of hands.

hand-recon predict photo.jpg --output outputs/my_hands
hand-recon predict holiday/*.jpg more_photos camera=fov=60
hand-recon predict photo.jpg ckpt=outputs/train/<time>     # a network of recipe=photos looks at it, too
hand-recon predict photos detector=boxes detector.boxes=boxes.json ckpt=outputs/train/<time>
hand-recon predict clip.mp4 motion.smoothing=0.05          # hands over time (docs/video.md)
hand-recon predict frames motion.fps=25                    # a folder of images in a row
hand-recon predict webcam                                  # as they move
hand-recon predict photo.jpg --json - | jq '.[].verdict'
"""

from collections.abc import Sequence

from hand_recon.command_line.hydra_verb import run_verb


def main(words: Sequence[str] | None = None) -> None:
    """Run the command.

    Args:
        words: The command line after the verb; none for this process's own.
    """
    run_verb("predict", __doc__ or "", words)


if __name__ == "__main__":
    main()
