"""The Rerun SDK, imported so that it does not write to the terminal in its own words.

It reports a full disk, say, on stderr as well as to its caller, and the caller already turns that
into one clear line. What it prints is set by RUST_LOG once and for all when it is imported; a
RUST_LOG that the user has set is kept.
"""

import os

_unset = "RUST_LOG" not in os.environ
if _unset:
    os.environ["RUST_LOG"] = "off"
try:
    import rerun as rr
    import rerun.blueprint as rrb
finally:
    if _unset:
        del os.environ["RUST_LOG"]

__all__ = ["rr", "rrb"]
