"""Colours of photographs: every mode of Pillow as 8-bit sRGB on white."""

import io
from typing import Final

import numpy as np
from PIL import Image, ImageCms

_SIXTEEN_BIT: Final = ("I;16", "I;16L", "I;16B", "I;16N")
_TRANSPARENT: Final = ("RGBA", "LA", "PA", "RGBa", "La")
_PLAIN: Final = ("1", "L", "P", "RGB", "RGBX", "CMYK", "YCbCr")


def to_srgb(image: Image.Image) -> tuple[Image.Image, tuple[str, ...]]:
    """Convert to RGB of 8 bits a channel: profiles to sRGB, transparency to white, 16 bits scaled to 8.

    Returns:
        Image of mode RGB, and notes on what was done to it.

    Raises:
        ValueError: The pixels are 32-bit or floating-point numbers, or in a colour space without conversion.
    """
    if image.mode in _SIXTEEN_BIT:
        return _grey_of_16_bits(image).convert("RGB"), ()
    if image.mode in _TRANSPARENT or "transparency" in image.info:
        return _on_white(image)
    if image.mode not in _PLAIN:
        wrong = {"I": "32-bit numbers", "F": "floating-point numbers"}.get(image.mode, image.mode)
        raise ValueError(f"Its pixels are {wrong}; expected RGB, CMYK or grey of 8 or 16 bits.")
    profiled, notes = _from_profile(image)
    return (profiled if profiled.mode == "RGB" else profiled.convert("RGB")), notes


def _grey_of_16_bits(image: Image.Image) -> Image.Image:
    levels = np.asarray(image).astype(np.float32) / 257
    return Image.fromarray(levels.round().astype(np.uint8))


def _on_white(image: Image.Image) -> tuple[Image.Image, tuple[str, ...]]:
    seen = image if image.mode == "RGBA" else image.convert("RGBA")
    alpha = seen.getchannel("A")
    white = Image.new("RGB", seen.size, "white")
    profile = image.info.get("icc_profile")
    coloured = seen.convert("RGB")
    if profile and image.mode == "RGBA":
        coloured.info["icc_profile"] = profile
    coloured, notes = _from_profile(coloured)
    white.paste(coloured, mask=alpha)
    if alpha.getextrema()[0] == 255:
        return white, notes
    return white, (*notes, "Its transparent parts are drawn on white.")


def _from_profile(image: Image.Image) -> tuple[Image.Image, tuple[str, ...]]:
    """Convert an RGB or CMYK image with a profile other than sRGB; one whose profile is damaged stays."""
    profile = image.info.get("icc_profile")
    if not profile or image.mode not in ("RGB", "CMYK"):
        return image, ()
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = ImageCms.getProfileDescription(source).strip()
        if "srgb" in name.lower():
            return image, ()
        converted = ImageCms.profileToProfile(
            image, source, ImageCms.createProfile("sRGB"), outputMode="RGB"
        )
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return image, ("Its colour profile cannot be used; its colours are taken for sRGB.",)
    if converted is None:
        return image, ()
    # Nothing is said: most photographs of telephones are converted.
    return converted, ()
