"""From a single-camera dance video to 3D motion that can be reviewed, exported and kept.

Importing the package loads nothing heavy; import the module of the stage you need.
"""

__version__ = "0.1.0"
