"""Three levels of difficulty of synthetic images; two cores learn the easiest in minutes.

The numbers are choices of this project, made by looking at images (`tools/draw_synthetic.py`). Pixels are
those of the reference crop (224), independent of the resolution.
"""

from dataclasses import dataclass
from typing import Any, Final

Range = tuple[float, float]


@dataclass(frozen=True)
class Level:
    """Distributions of pose, camera, background, objects, sensor and label noise."""

    name: str
    """Name, for messages and the cache."""
    pose_scale: float = 1.0
    """Factor on all joint angles."""
    independent_fingers: float = 0.0
    """Probability of a pose whose fingers are drawn independently, rather than a gesture."""
    pose_noise: float = 4.0
    """Standard deviation of the noise on joint angles, degrees."""
    shape_deviation: float = 1.0
    """Standard deviation of the shape coefficients."""
    cone: float = 40.0
    """Largest angle between the line of sight and the palm's normal, degrees; 180 allows all viewpoints."""
    roll: float = 30.0
    """Largest in-plane rotation from fingers up, degrees."""
    focal: Range = (500.0, 500.0)
    """Focal length, reference pixels."""
    principal_x: Range = (112.0, 112.0)
    """Horizontal principal point, reference pixels."""
    principal_y: Range = (112.0, 112.0)
    """Vertical principal point, reference pixels."""
    fill: Range = (0.68, 0.82)
    """Side of the landmarks' bounding square as a fraction of the crop."""
    shift: float = 0.03
    """Largest offset of the landmarks' centre from the crop's, as a fraction of the crop."""
    truncation: float = 0.0
    """Probability of an offset so large that the crop truncates the hand."""
    calm_background: float = 1.0
    """Probability of a plain or gradient background rather than a textured one."""
    clutter: float = 0.0
    """Probability of a background with many shapes, some in the colours of skin."""
    held_object: float = 0.0
    """Probability of an object in the grasp."""
    front_object: float = 0.0
    """Probability of an object between camera and hand."""
    sleeve: float = 0.3
    """Probability of a sleeve."""
    cast_shadows: float = 0.0
    """Probability that the key light casts shadows."""
    varied_light: bool = True
    """True if direction, strength and tint of the lights vary; else all are as on a clouded day."""
    skin_tones: bool = True
    """True if skin tones vary; else all are of one tone."""
    skin_texture: bool = True
    """True if skin has creases, redness and uneven colour."""
    nails: bool = True
    """True if nails have a colour of their own."""
    blur: float = 0.3
    """Largest standard deviation of the lens blur, reference pixels."""
    motion: float = 0.0
    """Largest length of motion blur, reference pixels."""
    sensor_noise: float = 0.01
    """Largest standard deviation of the sensor noise, as a fraction of white."""
    jpeg_quality: tuple[int, int] = (85, 98)
    """Range of JPEG qualities."""
    noise_visible: float = 1.0
    """Standard deviation of a visible landmark's label, reference pixels."""
    noise_hidden: Range = (2.0, 3.0)
    """Standard deviation of an occluded landmark's label, at 0 and at 4 cm of depth, reference pixels."""
    outliers: float = 0.0
    """Probability that a label is an outlier."""
    noise_outlier: float = 15.0
    """Standard deviation of an outlier's noise, reference pixels."""
    missing: float = 0.0
    """Probability that a landmark has no label."""


DIFFICULTIES: Final[dict[str, Level]] = {
    "easy": Level("easy"),
    "medium": Level(
        "medium", cone=80.0, roll=60.0, fill=(0.62, 0.83), shift=0.05, calm_background=0.25,
        held_object=0.15, front_object=0.1, sleeve=0.5, cast_shadows=0.5, blur=0.7, motion=1.5,
        sensor_noise=0.03, jpeg_quality=(60, 95), noise_visible=1.5, noise_hidden=(3.0, 5.0),
    ),
    "hard": Level(
        "hard", cone=180.0, roll=180.0, focal=(380.0, 1000.0), principal_x=(70.0, 154.0),
        principal_y=(70.0, 154.0), fill=(0.55, 0.85), shift=0.08, truncation=0.15,
        calm_background=0.05, clutter=0.5, held_object=0.3, front_object=0.3, sleeve=0.5,
        cast_shadows=0.7, blur=1.5, motion=4.0, sensor_noise=0.07, jpeg_quality=(30, 95),
        noise_visible=2.0, noise_hidden=(4.0, 8.0), outliers=0.02, missing=0.05,
    ),
    # Beside photographs: any pose from any side, cut and lit as photographs of hands are.
    "any_pose": Level(
        "any_pose", independent_fingers=0.7, cone=180.0, roll=60.0, focal=(400.0, 1200.0),
        principal_x=(90.0, 134.0), principal_y=(90.0, 134.0), fill=(0.58, 0.75), shift=0.05,
        calm_background=0.3, clutter=0.3, held_object=0.1, front_object=0.1, sleeve=0.5, cast_shadows=0.5,
        blur=1.5, motion=2.0, sensor_noise=0.04, jpeg_quality=(40, 95), noise_visible=0.0,
        noise_hidden=(0.0, 0.0),
    ),
}  # fmt: skip
"""Levels by name, from palms in front of plain walls to all viewpoints in clutter."""

FEATURES: Final[dict[str, dict[str, Any]]] = {
    "background": {"calm_background": 1.0, "clutter": 0.0},
    "objects": {"held_object": 0.0, "front_object": 0.0},
    "sleeve": {"sleeve": 0.0},
    "light": {"varied_light": False, "cast_shadows": 0.0},
    "sensor": {"blur": 0.0, "motion": 0.0, "sensor_noise": 0.0, "jpeg_quality": (98, 99)},
    "skin_tones": {"skin_tones": False},
    "skin_texture": {"skin_texture": False},
    "nails": {"nails": False},
}
"""Features that images can lack, for studies: changes to a level by name."""
