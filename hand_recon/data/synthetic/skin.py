"""Albedo of surfaces: skin with nails, creases and redness, cloth and painted objects.

Colours are procedural functions of the position in the rest pose, so that they move with the skin and are
as sharp as the image, independent of the resolution of the mesh.
"""

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.data.synthetic.levels import Level
from hand_recon.data.synthetic.planes import mixed
from hand_recon.data.synthetic.skin_map import CREASE, CREASE_REACH, NAIL, NAIL_BED, SkinMap

Colour = Float[np.ndarray, " 3"]

_MIDDLE: Final = 0.4
"""Melanin of everybody's skin at levels without `skin_tones`, from 0 (lightest) to 1 (darkest)."""

_TONES: Final = np.array(
    [[255, 224, 205], [241, 194, 160], [224, 172, 130], [190, 132, 92], [141, 90, 58], [84, 50, 34]]
)
"""Skin colours, sRGB 0–255, by increasing melanin; chosen by eye after Fitzpatrick's six types."""


_BLUSH: Final = np.array([0.02, 0.30, 0.26], dtype=np.float32)
_MOTTLE: Final = np.array([0.6, 1.0, 1.0], dtype=np.float32)


def linear(srgb: Float[np.ndarray, "*colours"]) -> Float[np.ndarray, "*colours"]:
    """Convert sRGB values, 0–1, to linear light with gamma 2.2."""
    return np.asarray(np.clip(srgb, 0, 1) ** 2.2)


@dataclass(frozen=True)
class SkinTone:
    """Skin colours of one person, all linear."""

    back: Colour
    """Albedo of the back of the hand."""
    palm: Colour
    """Albedo of the palm."""
    blush: float
    """Strength of the redness of knuckles and fingertips."""
    nail: Colour
    """Albedo of the nails."""
    mottle: float
    """Contrast of the uneven colour."""
    waves: Float[np.ndarray, "wave=6 4"]
    """Spatial frequencies (radians per metre) and phases of the uneven colour."""
    creases: float = 0.28
    """Darkness of the creases."""
    nails: bool = True
    """True if nails have a colour of their own."""
    polish: Colour | None = None
    """Albedo of the nail polish, linear; None without."""


@dataclass(frozen=True)
class SkinSpots:
    """Visible points of the skin."""

    texture: Float[np.ndarray, "3 hit"]
    """Position in the rest pose, metres."""
    dorsal: Float[np.ndarray, " hit"]
    """Side, from −1 (palmar) to 1 (dorsal)."""
    knuckle: Float[np.ndarray, " hit"]
    """Redness, 0–1."""
    vertex: Int[np.ndarray, " hit"]
    """First vertex of the hand's triangle; 0 on the forearm, which has no nails or creases."""

    def where(self, chosen: Bool[np.ndarray, " vertex"]) -> tuple[Int[np.ndarray, " some"], Self]:
        """Points on triangles that begin with chosen vertices, and their indices."""
        some = np.flatnonzero(chosen[self.vertex])
        columns = self.texture[:, some], self.dorsal[some], self.knuckle[some], self.vertex[some]
        return some, type(self)(*columns)


def sample_tone(random: np.random.Generator, *, held_out: bool) -> SkinTone:
    """Draw a skin tone; the test split's melanin is uniform over the scale."""
    melanin = random.uniform(0, 1) if held_out else random.beta(1.2, 1.2)
    tint = 1 + random.normal(scale=0.05 if held_out else 0.035, size=3)
    painted = random.random() < 0.15
    polish = linear(random.uniform(0.05, 0.95, size=3))
    colours = _skin_colours(melanin, tint, polish if painted else None)
    waves = np.column_stack([random.normal(scale=330.0, size=(6, 3)), random.uniform(0, 6.28, 6)])
    blush, mottle = random.uniform(0.2, 0.9), random.uniform(0.02, 0.06)
    return SkinTone(
        back=colours[0],
        palm=colours[1],
        blush=blush,
        nail=colours[2],
        mottle=mottle,
        waves=waves.astype(np.float32),
        polish=polish if painted else None,
    )


def plainer(tone: SkinTone, level: Level) -> SkinTone:
    """The same skin without what images of a level lack."""
    if not level.skin_tones:
        back, palm, nail = _skin_colours(_MIDDLE, np.ones(3), tone.polish)
        tone = replace(tone, back=back, palm=palm, nail=nail)
    if not level.skin_texture:
        tone = replace(tone, blush=0.0, mottle=0.0, creases=0.0)
    return tone if level.nails else replace(tone, nails=False)


def _skin_colours(
    melanin: float, tint: Colour, polish: Colour | None
) -> tuple[Colour, Colour, Colour]:
    """Albedo of the back of the hand, of the palm and of the nails, linear."""
    position = melanin * (len(_TONES) - 1)
    base = [np.interp(position, np.arange(len(_TONES)), _TONES[:, channel]) for channel in range(3)]
    back = linear(np.array(base) / 255) * tint
    pink = linear(np.array([0.90, 0.68, 0.60]))
    palm = back * (1 - 0.15 - 0.45 * melanin) + pink * (0.15 + 0.45 * melanin)
    if polish is None:
        polish = 0.55 * palm + 0.45 * linear(np.array([0.95, 0.80, 0.77]))
    return back.astype(np.float32), palm.astype(np.float32), polish.astype(np.float32)


def skin_albedo(tone: SkinTone, skin: SkinMap, spots: SkinSpots) -> Float[np.ndarray, "3 hit"]:
    """Albedo of the skin at points of the rest pose.

    Args:
        tone: Skin colours of the person.
        skin: Positions of nails and creases.
        spots: Points to colour.
    """
    albedo = mixed(tone.back, tone.palm, np.clip(0.5 - 0.9 * spots.dorsal, 0, 1))
    albedo *= 1 - tone.blush * spots.knuckle * _BLUSH[:, None]
    uneven = np.sin(tone.waves[:, :3] @ spots.texture + tone.waves[:, 3:]).mean(axis=0)
    albedo *= 1 + 2 * tone.mottle * uneven * _MOTTLE[:, None]
    some, creased = spots.where(skin.creased)
    albedo[:, some] *= 1 - tone.creases * _creases(skin, creased)
    if tone.nails:
        some, nailed = spots.where(skin.nailed)
        nails = _nails(skin, nailed)
        albedo[:, some] = albedo[:, some] * (1 - nails) + tone.nail[:, None] * nails
    return albedo


def _creases(skin: SkinMap, spots: SkinSpots) -> Float[np.ndarray, " hit"]:
    """Strength, 0–1, of thin lines across the fingers at the joints, stronger on the palmar side."""
    which = skin.crease_of[spots.vertex]
    local = _in_frames(spots.texture.T, skin.joints[which], skin.frames[which])
    near = (np.abs(local[:, 1:]) < CREASE_REACH[1:]).all(axis=1)
    line = np.exp(-((local[:, 0] / CREASE) ** 2))
    return line * near * (0.65 - 0.35 * spots.dorsal)


def _nails(skin: SkinMap, spots: SkinSpots) -> Float[np.ndarray, " hit"]:
    """Coverage by nails: 1 inside, 0 outside, with a soft edge."""
    which = skin.nail_of[spots.vertex]
    local = _in_frames(spots.texture.T, skin.nail_centres[which], skin.nail_frames[which])
    squared = (local[:, ::2] / (NAIL * skin.nail_size[which][:, None])) ** 2
    radius = np.sqrt(np.sqrt((squared * squared).sum(axis=1)))
    return np.clip((1 - radius) * 6, 0, 1) * (local[:, 1] > NAIL_BED)


def _in_frames(
    points: Float[np.ndarray, "hit 3"],
    origins: Float[np.ndarray, "hit 3"],
    frames: Float[np.ndarray, "hit 3 3"],
) -> Float[np.ndarray, "hit 3"]:
    """Coordinates along the rows of each point's frame."""
    offsets = np.ascontiguousarray(points) - origins
    return np.asarray((frames @ offsets[:, :, None])[:, :, 0])


@dataclass(frozen=True)
class Paint:
    """Stripes of two colours for cloth and objects."""

    colours: Float[np.ndarray, "2 3"]
    """The two colours, linear."""
    wave: Float[np.ndarray, " 4"]
    """Spatial frequency (radians per metre) and phase of the stripes."""
    contrast: float
    """Contrast of the stripes, 0–1; 0 is a single colour."""


def sample_paint(random: np.random.Generator) -> Paint:
    """Draw two colours and stripes; half of all paints have a single colour."""
    direction = random.normal(size=3)
    frequency = random.uniform(150, 900) * direction / np.linalg.norm(direction)
    contrast = 0.0 if random.random() < 0.5 else random.uniform(0.3, 1.0)
    colours = linear(random.uniform(0.05, 0.95, size=(2, 3))).astype(np.float32)
    wave = np.append(frequency, random.uniform(0, 6.28)).astype(np.float32)
    return Paint(colours, wave, contrast)


def paint_albedo(paint: Paint, texture: Float[np.ndarray, "hit 3"]) -> Float[np.ndarray, "3 hit"]:
    """Albedo of the pattern at texture coordinates."""
    stripe = np.clip(2 * np.sin(texture @ paint.wave[:3] + paint.wave[3]), -1, 1)
    return mixed(paint.colours[0], paint.colours[1], paint.contrast * (0.5 + 0.5 * stripe))
