"""`python -m dance2pose`, and what the installed `dance2pose` runs."""

from __future__ import annotations

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line; Ctrl-C is one line and status 130 even while it is being imported."""
    try:
        from dance2pose.cli import main as run

        run()
    except KeyboardInterrupt:
        print("dance2pose: stopped", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
