"""Rendered dancers: a clothed, shaded, articulated figure moved by motion capture.

Used by scripts/make_demo_clip.py and scripts/train_demo_models.py, not by the package. Needs
moderngl (any OpenGL 3.3; Mesa's software renderer through EGL is enough) and scikit-image.
Lengths are metres, axes x towards the figure's left, y up, z forward in its rest pose.
"""
