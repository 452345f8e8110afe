"""`python -m dance2pose`."""

from dance2pose.cli import main

main()
