"""A window for the frames of a live view: OpenCV's where it has one, else Tk's."""

import importlib
import logging
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

logger = logging.getLogger(__name__)

Drawing = UInt8[np.ndarray, "height width 3"]


@runtime_checkable
class Window(Protocol):
    """Somewhere to show frames."""

    def show(self, pixels: Drawing) -> bool:
        """Show a frame, RGB; false once the user has closed the window or pressed q or Escape."""
        ...

    def close(self) -> None:
        """Close the window."""
        ...


class OpenCvWindow:
    """Window of an OpenCV that was built with one, such as the package `opencv-python`."""

    def __init__(self, title: str) -> None:
        self.title = title
        cv2.namedWindow(title, cv2.WINDOW_NORMAL | cv2.WINDOW_KEEPRATIO)

    def show(self, pixels: Drawing) -> bool:
        """Show a frame; false once the window was closed or q or Escape was pressed.

        Args:
            pixels: RGB.
        """
        cv2.imshow(self.title, pixels[..., ::-1])
        key = cv2.waitKey(1) & 0xFF
        return key not in (27, ord("q")) and (
            cv2.getWindowProperty(self.title, cv2.WND_PROP_VISIBLE) >= 1
        )

    def close(self) -> None:
        """Close the window."""
        cv2.destroyWindow(self.title)


class TkWindow:
    """Window of Tk, which comes with most Pythons."""

    def __init__(self, title: str) -> None:
        tkinter: Any = importlib.import_module("tkinter")
        self._images: Any = importlib.import_module("PIL.ImageTk")
        self._pillow: Any = importlib.import_module("PIL.Image")
        self.root = tkinter.Tk()
        self.root.title(title)
        self.label = tkinter.Label(self.root)
        self.label.pack()
        self.is_open = True
        self.root.protocol("WM_DELETE_WINDOW", self._end)
        for key in ("<Escape>", "q"):
            self.root.bind(key, lambda _: self._end())

    def _end(self) -> None:
        self.is_open = False

    def show(self, pixels: Drawing) -> bool:
        """Show a frame; false once the window was closed or q or Escape was pressed.

        Args:
            pixels: RGB.
        """
        image = self._images.PhotoImage(self._pillow.fromarray(pixels))
        self.label.configure(image=image)
        # Tk keeps no reference of its own.
        self.label.image = image
        self.root.update()
        return self.is_open

    def close(self) -> None:
        """Close the window."""
        self.root.destroy()


def open_window(title: str) -> Window | None:
    """Open a window; none, with a note, where there is no display or nothing that opens one.

    Args:
        title: Title of the window.
    """
    reasons = []
    for kind in (OpenCvWindow, TkWindow):
        try:
            return kind(title)
        except Exception as error:  # noqa: BLE001  # each library has errors of its own
            reasons.append(
                str(error).strip().splitlines()[-1] if str(error).strip() else repr(error)
            )
    logger.info(
        "There is no window (%s). Frames are shown where there is a display and either Tk, which comes with "
        "most Pythons, or the package opencv-python in the place of opencv-python-headless.",
        "; ".join(reasons),
    )  # fmt: skip
    return None
