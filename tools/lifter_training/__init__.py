"""Parts of `tools/build_lifter.py`: made-up hands, their views, and training on 2D landmarks alone."""
