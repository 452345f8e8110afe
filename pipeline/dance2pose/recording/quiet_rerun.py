"""The Rerun SDK, imported so that it neither writes to the terminal in its own words nor keeps
memory that it has done with.

It reports a full disk, say, on stderr as well as to its caller, and the caller already turns that
into one clear line. Its allocator gives memory back to the system some time after it was let go, or
never; over an hour of video that came to 45 MB for the pieces of the video and 100 MB for the poses
(measured, rerun 0.41). Both are set by the environment once and for all when it is imported; what
the user has set there is kept.
"""

import os

_WANTED = {"RUST_LOG": "off", "MIMALLOC_PURGE_DELAY": "0"}

_unset = [name for name in _WANTED if name not in os.environ]
os.environ.update({name: _WANTED[name] for name in _unset})
try:
    import rerun as rr
    import rerun.blueprint as rrb
finally:
    for name in _unset:
        del os.environ[name]

__all__ = ["rr", "rrb"]
